"""The plan of readings of several bits, beside simulated readings and exact sums."""

import numpy as np
import pytest
from scipy.stats import norm, poisson

import jotlight as jl
from jotlight.estimators import planned_readings


def simulated(sensor, light, frames, max_light, rng, number=40_000):
    """Return the bias and the mean square error of simulated estimates, and their errors."""
    highest = sensor.max_reading
    rates = np.linspace(0, 2 * highest, 8001)
    below = np.arange(highest)
    means = np.array([highest - poisson.cdf(below, rate).sum() for rate in rates])
    readings = np.minimum(rng.poisson(light, (number, frames)), highest).mean(axis=1)
    if max_light is None:
        max_light = np.interp(highest - 0.5 / frames, means, rates)
    error = np.minimum(np.interp(readings, means, rates), max_light) - light
    deviations = error.std(), (error**2).std()
    return error.mean(), (error**2).mean(), np.array(deviations) / np.sqrt(number)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("light", "frames", "max_intensity"),
    # From 2056 frames on, some probabilities of totals are not computed.
    [
        (100, 4, 90.0),
        (100, 4000, 90.0),
        pytest.param(100, 4000, None, marks=pytest.mark.exhaustive),
        pytest.param(240, 3000, None, marks=pytest.mark.exhaustive),
        (290, 3000, None),
    ],
)
def test_clipped_and_saturated_estimates_agree_with_simulated_ones(light, frames, max_intensity):
    sensor = jl.Sensor(bit_depth=8, max_intensity=max_intensity or 1.0)
    plan = jl.plan(sensor, float(light), frames=[frames], max_intensity=max_intensity)
    rng = np.random.default_rng(light + frames)
    bias, mse, errors = simulated(sensor, light, frames, max_intensity, rng, 3000)
    assert abs(plan.bias[0, 0] - bias) < 4 * errors[0] + 1e-9
    assert abs(plan.rmse[0, 0] ** 2 - mse) < 4 * errors[1] + 1e-9


def test_clipping_does_not_depend_on_the_number_of_frames():
    sensor = jl.Sensor(bit_depth=12)
    plan = jl.plan(sensor, (50, 100), frames=[16, 31, 33, 64, 10**7], max_intensity=60.0)
    np.testing.assert_allclose(plan.bias[:, -1], -40, atol=1e-6)
    assert plan.psnr.max() - plan.psnr.min() < 0.1


def test_light_above_saturation_has_a_plan():
    sensor = jl.Sensor(bit_depth=12)
    with np.errstate(all="raise", under="ignore"):
        plan = jl.plan(sensor, (5000, 6000), frames=[16, 33, 10**6], speed=0.1)
    assert np.isfinite(plan.bias).all()
    # The estimate is nearly always the largest one.
    np.testing.assert_allclose(plan.bias[:, -1], -plan.rmse[:, -1], rtol=1e-3)
    assert (plan.bias < -400).all()
    assert (np.diff(plan.bias[:, -1]) > 0).all()


@pytest.mark.parametrize("light", [0.02, 3.0, 12.5, 16.0])
@pytest.mark.parametrize("max_intensity", [None, 12.0])
@pytest.mark.parametrize("branch", ["window", "normal"])
def test_all_kinds_of_sums_agree(monkeypatch, light, max_intensity, branch):
    sensor, frames = jl.Sensor(bit_depth=4, dark_counts=0.01), [1000]
    exact = jl.plan(sensor, light, frames=frames, max_intensity=max_intensity)
    monkeypatch.setattr(planned_readings, "_MIN_TOTALS", 64)
    if branch == "normal":
        monkeypatch.setattr(planned_readings, "_MAX_TOTALS", 16)
    other = jl.plan(sensor, light, frames=frames, max_intensity=max_intensity)
    tolerance = 1e-6 if branch == "window" else 0.02
    np.testing.assert_allclose(other.rmse, exact.rmse, rtol=tolerance)
    assert abs(other.bias - exact.bias)[0, 0] < tolerance * exact.rmse[0, 0]


def test_clipped_estimates_of_many_frames_have_their_closed_form():
    # The standard deviation of a reading is 54, so from 10,000 frames on, a distribution is normal.
    sensor, light, excess = jl.Sensor(bit_depth=12), 2900.0, 0.3
    frames = np.array([32, 8000, 9000, 10_000, 11_000, 10**6, 10**9 // 2])
    plan = jl.plan(sensor, light, frames=frames.tolist(), max_intensity=light + excess)
    deviation = np.sqrt(light / frames)
    limit = excess / deviation
    bias = deviation * (limit * norm.sf(limit) - norm.pdf(limit))
    np.testing.assert_allclose(plan.bias[:, 0] / deviation, bias / deviation, rtol=2e-3, atol=1e-5)
    square = norm.cdf(limit) - limit * norm.pdf(limit) + limit**2 * norm.sf(limit)
    np.testing.assert_allclose(plan.rmse[:, 0], deviation * np.sqrt(square), rtol=2e-3)
