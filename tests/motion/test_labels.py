"""Values of pixels, chosen by their labels."""

import numpy as np
import pytest

from jotlight.motion.labels import choose

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("shape", [(), (2,)])
@pytest.mark.parametrize("number", [1, 2, 7])
def test_each_pixel_has_the_value_of_its_field(number, shape):
    fields = list(RNG.random((number, *shape, 5, 8)))
    kept = [field.copy() for field in fields]
    labels = RNG.integers(0, number, (5, 8)).astype(np.uint8)
    np.testing.assert_array_equal(choose(labels, fields), np.choose(labels, fields))
    np.testing.assert_array_equal(fields, kept)
