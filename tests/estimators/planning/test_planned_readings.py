"""The plan of readings of several bits, beside simulated captures and closed forms."""

import numpy as np
import pytest
from scipy.stats import norm

import jotlight as jl
from jotlight.estimators.planning import planned_estimates
from jotlight.sensing.likelihood.reference import saturation_intensity


def simulated(sensor, light, frames, rng, number=10_000):
    """Return the root mean square error of `jl.mle` in simulated captures."""
    sensor = sensor.replace(frames=frames)
    sensor = sensor.replace(max_intensity=saturation_intensity(sensor))
    unit = sensor.light_per_intensity
    side = round(number**0.5)
    estimate = jl.mle(sensor.expose(np.full((side, side), light / unit), rng=rng), sensor)
    return np.sqrt(np.mean((estimate.astype(np.float64) * unit - light) ** 2))


KINDS = [
    ({"bit_depth": 2}, 4, 0.6),
    ({"bit_depth": 4}, 1, 0.6),
    ({"bit_depth": 4}, 16, 0.6),
    ({"bit_depth": 4}, 64, 0.3),
    ({"bit_depth": 8}, 16, 0.6),
    ({"bit_depth": 12}, 4, 0.6),
    ({"read_noise": 0.3}, 4, 0.6),
    ({"bit_depth": 4, "read_noise": 0.4, "efficiency": 0.7, "dark_counts": 0.1}, 64, 0.3),
]


def kinds_and_parts():
    """Yield all products. The fast ones have every kind and every part."""
    for i, kind in enumerate(KINDS):
        for j, part in enumerate((0.5, 1.0, 1.3)):
            marks = [] if i % 3 == j else [pytest.mark.slow]
            yield pytest.param(*kind, part, marks=marks)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "frames", "tolerance", "part"), list(kinds_and_parts()), ids=str
)
def test_the_error_is_that_of_simulated_captures(options, frames, tolerance, part):
    sensor = jl.Sensor(**options)
    light = part * sensor.max_reading / sensor.efficiency
    plan = jl.plan(sensor, light, frames=[frames])
    error = simulated(sensor, light, frames, rng=frames)
    assert abs(20 * np.log10(plan.rmse[0, 0] / error)) < tolerance


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bit_depth", "noise", "light", "frames"),
    [
        (4, 0.4, 0.01, 1024),
        (4, 0.4, 0.01, 64),
        (2, 0.3, 0.001, 1),
        (2, 0.3, 0.001, 64),
        (8, 0.4, 0.001, 16),
        (8, 0.4, 0.1, 16),
    ],
)
def test_plans_of_little_light_with_read_noise_are_right(bit_depth, noise, light, frames):
    sensor = jl.Sensor(bit_depth=bit_depth, read_noise=noise)
    plan = jl.plan(sensor, light, frames=[frames])
    error = simulated(sensor, light, frames, rng=0, number=128**2)
    assert abs(20 * np.log10(error / plan.rmse[0, 0])) < 0.4


@pytest.mark.parametrize(
    ("bit_depth", "noise", "light", "largest", "exact"),
    [
        (2, 0.05, 0.001, None, -30.0),  # the sums of few scores are not continuous
        (2, 0.3, 0.1, 30.0, -16.6),  # there are no estimates just below this S
    ],
)
def test_plans_of_one_reading_are_those_of_a_sum_over_all_readings(
    bit_depth, noise, light, largest, exact
):
    sensor = jl.Sensor(bit_depth=bit_depth, read_noise=noise)
    plan = jl.plan(sensor, light, frames=[1], max_intensity=largest)
    assert 20 * np.log10(light / plan.rmse[0, 0]) == pytest.approx(exact, abs=0.3)


@pytest.mark.slow
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
def test_both_kinds_of_sums_agree(monkeypatch, light, max_intensity):
    sensor, frames = jl.Sensor(bit_depth=4, dark_counts=0.01), [1000]
    exact = jl.plan(sensor, light, frames=frames, max_intensity=max_intensity)
    monkeypatch.setattr(planned_estimates, "_MAX_SUMS", 16)
    normal = jl.plan(sensor, light, frames=frames, max_intensity=max_intensity)
    np.testing.assert_allclose(normal.rmse, exact.rmse, rtol=0.02)
    assert abs(normal.bias - exact.bias)[0, 0] < 0.02 * exact.rmse[0, 0]


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
