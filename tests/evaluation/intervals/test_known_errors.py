"""Known errors of an estimate."""

import numpy as np

from jotlight.evaluation.intervals.error_scale import error_model
from jotlight.evaluation.intervals.known_errors import KnownErrors


def test_the_errors_of_another_estimate_add_the_mean_square_of_the_difference():
    rng = np.random.default_rng(0)
    scale, difference = rng.random((2, 12, 15))
    known = KnownErrors(np.zeros((12, 15), np.float32), scale, [], error_model())
    found = known.widened(difference).scale
    for row, column in ((5, 8), (0, 0), (11, 14)):
        rows, columns = (np.arange(-3, 4) + place for place in (row, column))
        mirrored = [
            np.where(index > last, 2 * last - index, abs(index))
            for index, last in ((rows, 11), (columns, 14))
        ]
        mean = (difference[np.ix_(*mirrored)] ** 2).mean()
        expected = np.sqrt(scale[row, column] ** 2 + mean / 1.4**2)
        np.testing.assert_allclose(found[row, column], expected, rtol=1e-12)
