"""The error of the estimate by saddle points."""

import numpy as np
import pytest
from scipy import stats

from jotlight.estimators.planning.planned_estimates import PlannedGroup
from jotlight.estimators.planning.saddle_point import SaddlePoints
from jotlight.sensing.parameters.response import JotResponse

BITS = PlannedGroup(JotResponse(1, 0.0, 1), 1.0, 0.0)


@pytest.mark.parametrize(("level", "number"), [(0.3, 20), (0.05, 100), (1.0, 40)])
def test_the_tail_is_that_of_a_binomial_number(level, number):
    points = SaddlePoints.of(BITS, level, 5.0)
    p = -np.expm1(-level)
    # The estimate exceeds t if more than n P(t) bits are 1. The approximation is continuous.
    needed = -number * np.expm1(-points.lights)
    ones = stats.binom(number, p)
    low, high = ones.sf(np.ceil(needed)), ones.sf(np.floor(needed) - 1)
    found = points.exceedance(number)
    assert ((low - 0.02 < found) & (found < high + 0.02)).all()


@pytest.mark.parametrize("number", [1, 64, 10**6])
def test_saddle_points_are_zeros_of_the_derivative(number):
    group = PlannedGroup(JotResponse(15, 0.4, 1), 1.0, 0.0)
    points = SaddlePoints.of(group, 0.01, 5.0)
    _, readings, p = group.probabilities(np.array([0.01]))
    for light, u in zip(points.lights[::20], points.places[::20], strict=True):
        scores = group.scores(readings[p > 1e-15], float(light))
        weights = p[p > 1e-15] * np.exp(u * scores - (u * scores).max())
        assert abs((weights * scores).sum()) < 1e-6 * (weights * np.abs(scores)).sum()
    assert np.isfinite(points.exceedance(number)).all()
