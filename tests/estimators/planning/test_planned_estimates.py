"""The planned error of an estimate, beside exact sums over all outcomes."""

import itertools

import numpy as np
import pytest
from scipy import stats

import jotlight as jl
from jotlight.estimators.planning.planned_estimates import PlannedEstimates, PlannedGroup
from jotlight.estimators.readings.joint_mle import maximize
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.parameters.response import JotResponse


@pytest.mark.parametrize("threshold", [1, 3])
@pytest.mark.parametrize("level", [0.02, 0.7, 4.0])
@pytest.mark.parametrize("number", [1, 7, 300])
def test_the_error_of_equal_bits_is_exact(threshold, level, number):
    group = PlannedGroup(JotResponse(1, 0.0, threshold), 0.8, 0.01)
    found = PlannedEstimates([group], level).bias_and_mse([number], level, 9.0)
    expected = exact_error(threshold, level, number, 9.0)
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-3 * expected[1] ** 0.5)


def exact_error(threshold, level, number, limit):
    counts = np.arange(number + 1)
    sensor = jl.Sensor(
        frames=number, threshold=threshold, efficiency=0.8, dark_counts=0.01, max_intensity=limit
    )
    estimates = jl.mle(counts[None], sensor)[0].astype(np.float64)
    weights = stats.binom.pmf(counts, number, stats.poisson.sf(threshold - 1, 0.8 * level + 0.01))
    return weights @ (estimates - level), weights @ (estimates - level) ** 2


def test_the_error_of_a_bracket_is_near_that_of_all_outcomes():
    exposures, number, limit = np.array([1.0, 1 / 8]), 6, 40.0
    sensor = jl.Sensor(frames=12, gain=np.repeat(exposures, number), max_intensity=limit)
    counts = np.array(list(itertools.product(range(number + 1), repeat=2)))
    ones = np.concatenate([np.arange(number)[:, None] < each for each in counts.T])[:, None]
    estimates = maximize(joint_likelihood(jl.Bits.from_array(ones), sensor, None))[0]
    groups = [PlannedGroup(JotResponse(1, 0.0, 1), 1.0, 0.0, exposure) for exposure in exposures]
    plan = PlannedEstimates(groups, 30.0)
    for level in (0.1, 1.0, 4.0, 10.0):
        weights = stats.binom.pmf(counts, number, -np.expm1(-level * exposures)).prod(axis=1)
        expected = weights @ (estimates - level) ** 2
        _, mse = plan.bias_and_mse([number, number], level, limit)
        assert abs(10 * np.log10(mse / expected)) < 0.5


def test_light_far_above_saturation_has_the_largest_estimate():
    groups = [PlannedGroup(JotResponse(15, noise, 1), 1.0, 0.0) for noise in (0.0, 0.3)]
    for group in groups:
        bias, mse = PlannedEstimates([group], 500.0).bias_and_mse([20], 500.0, 30.0)
        assert (bias, mse) == pytest.approx((-470, 470**2))


def test_light_far_below_the_threshold_has_the_estimate_0():
    bits = PlannedGroup(JotResponse(1, 0.0, 16), 1.0, 0.0)
    assert PlannedEstimates([bits], 40.0).bias_and_mse([100], 0.3, 60.0) == (-0.3, 0.09)
