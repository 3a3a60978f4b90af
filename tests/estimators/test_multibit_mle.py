"""Maximum likelihood, equivalent counts, intervals, and plans for readings of several bits."""

import numpy as np
import pytest
from scipy import optimize

import jotlight as jl
from jotlight.estimators.merge_readings import counts_at_maximum
from jotlight.estimators.planning.bracketing import intensity_range, snr_bound
from jotlight.estimators.readings.joint_mle import maximize, regular_maximum
from jotlight.estimators.readings.reference_sensors import reference_sensor
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.likelihood.multibit import reading_probability

SCENE = np.geomspace(0.02, 1.5, 12 * 10).reshape(12, 10)

SENSORS = {
    "four bits": jl.Sensor(frames=6, gain=18.0, bit_depth=4, max_intensity=9.0),
    "noise": jl.Sensor(frames=6, gain=18.0, bit_depth=3, read_noise=0.3, max_intensity=9.0),
    "noisy bits": jl.Sensor(frames=20, read_noise=0.25, max_intensity=9.0),
    "noisy bits of q": jl.Sensor(
        frames=20, gain=60.0, threshold=3, read_noise=0.3, max_intensity=9.0
    ),
    "bracket": jl.Sensor(
        frames=6, gain=np.repeat([1.0, 9.0], 3), bit_depth=2, read_noise=0.2, max_intensity=9.0
    ),
    "jots that differ": jl.Sensor(
        oversampling=2,
        frames=3,
        gain=30.0,
        bit_depth=2,
        read_noise=0.3,
        dark_counts=np.linspace(0, 0.5, 480).reshape(24, 20),
        mask=np.arange(480).reshape(24, 20) % 11 == 0,
        max_intensity=9.0,
    ),
    "many bits": jl.Sensor(frames=2, gain=900.0, bit_depth=12, read_noise=0.3, max_intensity=9.0),
}


def log_likelihood(sensor, readings, row, column, intensity):
    """Return the log-likelihood of a pixel: a plain sum over its readings."""
    side, total = sensor.oversampling, 0.0
    for group in sensor.groups():
        own = group.sensor
        for jot in np.ndindex(side, side):
            place = row * side + jot[0], column * side + jot[1]
            if sensor.mask is not None and sensor.mask[place]:
                continue
            dark = sensor.dark_counts
            dark = dark[place] if isinstance(dark, np.ndarray) else dark
            rate = intensity * own.light_per_intensity + dark
            for frame in group.frames:
                total += np.log(
                    reading_probability(
                        int(readings[(frame, *place)]),
                        rate,
                        bit_depth=own.bit_depth,
                        read_noise=own.read_noise,
                        threshold=own.threshold,
                    )
                )
    return float(total)


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
def test_the_maximum_is_that_of_brute_force(sensor):
    data = sensor.expose(SCENE, rng=2)
    readings = np.asarray(data).astype(int)
    estimate = jl.mle(data)
    for place in [(0, 0), (6, 5)]:

        def cost(v, place=place):
            with np.errstate(divide="ignore"):
                return -log_likelihood(sensor, readings, *place, np.exp(v))

        grid = np.linspace(np.log(1e-6), np.log(9.0), 40)
        best = grid[np.argmin([cost(v) for v in grid])]
        step = grid[1] - grid[0]
        found = optimize.minimize_scalar(
            cost,
            bounds=(best - step, min(best + step, grid[-1])),
            method="bounded",
            options={"xatol": 1e-9},
        )
        assert estimate[place] == pytest.approx(np.exp(found.x), rel=1e-3, abs=3e-6)


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
def test_the_slope_vanishes_at_the_maximum(sensor):
    joint = joint_likelihood(sensor.expose(SCENE, rng=2), sensor, None)
    x = maximize(joint)
    gradient, curvature = joint.gradient_and_curvature(x)
    inside = (x > 0) & (x < sensor.max_intensity)
    assert inside.sum() > 50
    assert (np.abs(gradient) <= 1e-6 * np.sqrt(curvature) + 1e-6)[inside].all()
    assert (gradient[x == 0] <= 0).all()


def test_without_noise_and_saturation_the_maximum_is_the_mean():
    sensor = jl.Sensor(frames=9, gain=18.0, bit_depth=8, dark_counts=0.25, max_intensity=9.0)
    readings = sensor.expose(SCENE, rng=0)
    mean = readings.to_array().mean(axis=0)
    expected = np.maximum(mean - 0.25, 0) / 2
    np.testing.assert_allclose(jl.mle(readings), expected, rtol=1e-6, atol=1e-9)


def test_all_dark_and_all_saturated_pixels_are_at_the_ends():
    sensor = jl.Sensor(frames=4, gain=8.0, bit_depth=2, read_noise=0.3, max_intensity=5.0)
    array = np.zeros((4, 1, 2), int)
    array[:, 0, 1] = 3
    np.testing.assert_array_equal(jl.mle(jl.Readings(array, sensor)), [[0, 5]])


@pytest.mark.parametrize("name", ["four bits", "bracket", "many bits", "noise", "noisy bits"])
def test_equivalent_counts_have_the_same_maximum_and_information(name):
    sensor = SENSORS[name]
    joint = joint_likelihood(sensor.expose(SCENE, rng=4), sensor, None)
    reference = reference_sensor(sensor)
    assert reference.has_plain_bits
    ones, trials = counts_at_maximum(joint, reference, regular_maximum(joint))
    x = maximize(joint)
    clear = (x > 0.1) & (x < 5) & (joint.total > 0) & (joint.total < joint.max_total)
    assert clear.sum() > 40
    slope = reference.light_per_intensity
    rate = slope * x + reference.dark_counts
    fraction = ones / trials
    np.testing.assert_allclose(fraction[clear], -np.expm1(-rate)[clear], rtol=1e-5)
    own = trials[clear] * slope**2 / np.expm1(rate[clear])
    np.testing.assert_allclose(own, joint.information(x)[clear], rtol=1e-5)


def test_the_gain_of_the_reference_sensor_leaves_bright_pixels_unsaturated():
    sensor = jl.Sensor(frames=2, gain=400.0, bit_depth=12)
    assert reference_sensor(sensor).gain == pytest.approx(0.5)
    assert reference_sensor(sensor.replace(gain=0.1)).gain == pytest.approx(0.1)


@pytest.mark.slow
def test_merged_readings_serve_every_method():
    sensor = SENSORS["noise"].replace(max_intensity=2.0)
    readings = sensor.expose(np.kron(SCENE, np.ones((2, 2))), rng=0)
    for method in ("admm-tv", "mle-iterative", "network-small", "noniterative-tv", "held-out"):
        assert jl.reconstruct(readings, method=method).shape == (24, 20)
    merged = jl.merge_readings(readings)
    np.testing.assert_array_equal(
        jl.reconstruct(readings, method="mle-iterative"),
        jl.reconstruct(merged, method="mle-iterative"),
    )
    color = sensor.expose(np.stack([SCENE, SCENE], -1), rng=0, channel_axis=-1)
    assert jl.reconstruct(color).shape == (12, 10, 2)
    np.testing.assert_array_equal(jl.mle(color)[..., 1], jl.mle(color.channels()[1]))
    stack = sensor.expose(np.stack([SCENE, SCENE]), rng=0)
    np.testing.assert_array_equal(jl.mle(stack)[1], jl.mle(stack[1]))


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=3, gain=3.0, bit_depth=2, read_noise=0.3, max_intensity=20.0),
        jl.Sensor(frames=3, gain=3.0, bit_depth=3, max_intensity=20.0),
        jl.Sensor(frames=8, read_noise=0.4, max_intensity=20.0),
        jl.Sensor(frames=2, gain=[1.0, 5.0], bit_depth=2, max_intensity=20.0),
    ],
)
def test_the_exact_coverage_of_the_interval_is_at_least_the_stated_one(sensor):
    # All outcomes of a pixel, each with its probability.
    levels, frames = sensor.max_reading + 1, sensor.frames
    outcomes = np.indices((levels,) * frames).reshape(frames, 1, -1)
    if sensor.bit_depth > 1:
        data = jl.Readings(outcomes, sensor)
    else:
        data = jl.Bits.from_array(outcomes, sensor).replace(tested_for_periods=True)
    known = jl.uncertainty(data, method="mle", confidence_level=0.9)
    lights = {
        frame: group.sensor.light_per_intensity
        for group in sensor.groups()
        for frame in group.frames
    }
    for intensity in np.geomspace(0.01, 15, 40):
        weights = np.ones(outcomes.shape[-1])
        for frame in range(frames):
            each = reading_probability(
                np.arange(levels),
                intensity * lights[frame],
                bit_depth=sensor.bit_depth,
                read_noise=sensor.read_noise,
            )
            weights *= each[outcomes[frame, 0]]
        covered = (known.low[0] <= intensity) & (intensity <= known.high[0])
        assert weights @ covered >= 0.9 - 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", ["many bits", "jots that differ"])
def test_normal_intervals_cover_about_as_stated(name):
    sensor = SENSORS[name]
    scene = np.full((12, 10), 0.8)
    covered = []
    for seed in range(8):
        known = jl.uncertainty(sensor.expose(scene, rng=seed), method="mle", confidence_level=0.9)
        covered.append((known.low <= scene) & (scene <= known.high))
    # 960 pixels: the standard deviation of the fraction is 1 %.
    assert 0.86 < np.mean(covered) < 0.98


def test_four_bits_widen_the_range_of_light():
    ranges = []
    for bit_depth in (1, 2, 4):
        low, high = intensity_range(jl.Sensor(frames=48, bit_depth=bit_depth), 9.0)
        ranges.append(20 * np.log10(high / low))
    assert ranges[0] == pytest.approx(28.9, abs=0.1)
    assert ranges[1] > ranges[0] + 5
    assert ranges[2] > ranges[1] + 8
    # A Poisson count has an SNR of T light.
    bound = snr_bound(jl.Sensor(frames=48, bit_depth=8), [0.5])[0]
    assert bound == pytest.approx(10 * np.log10(24), abs=1e-3)


@pytest.mark.parametrize(
    "sensor", [jl.Sensor(bit_depth=3, read_noise=0.3), jl.Sensor(read_noise=0.3, dark_counts=0.1)]
)
def test_the_plan_agrees_with_simulated_estimates(sensor):
    plan = jl.plan(sensor, 2.0, frames=[4], max_intensity=30.0)
    several = sensor.replace(frames=4, max_intensity=30.0)
    readings = np.asarray(several.expose(np.full((300, 300), 2.0), rng=0)).astype(float)
    total = readings.sum(axis=0)
    moments = plan.rmse[0, 0] ** 2 - plan.bias[0, 0] ** 2
    # The estimate of the plan, from the same formula for means, by a table of exact moments.
    grid = np.linspace(0, 40, 40001)
    all_readings = np.arange(sensor.max_reading + 1)
    probability = reading_probability(
        all_readings,
        grid[:, None] + sensor.dark_counts,
        bit_depth=sensor.bit_depth,
        read_noise=sensor.read_noise,
    )
    estimate = np.minimum(np.interp(total / 4, probability @ all_readings, grid), 30)
    if sensor.bit_depth > 1:
        assert np.var(estimate) == pytest.approx(moments, rel=0.05)
        assert np.mean(estimate) - 2 == pytest.approx(plan.bias[0, 0], abs=0.02)
    assert plan.snr_bound[0, 0] == pytest.approx(snr_bound(several, [2.0])[0])


@pytest.mark.slow
def test_plans_find_frames_and_saturation():
    light, frames = (0.05, 4.0), [1, 16]
    noisy = jl.Sensor(bit_depth=4, read_noise=0.2)
    plan = jl.plan(noisy, light, frames=frames, target_psnr=15.0)
    one_bit = jl.plan(jl.Sensor(), light, frames=frames, target_psnr=15.0)
    assert plan.required_frames < one_bit.required_frames
    assert plan.saturation_light[0] > one_bit.saturation_light[0]
    bracket = jl.plan_brackets(jl.Sensor(frames=24, bit_depth=3, read_noise=0.2), (0.05, 500.0))
    assert bracket.sensor.bit_depth == 3
    assert bracket.sensor.readings_differ
    with pytest.raises(ValueError, match="expected one gain and one threshold"):
        jl.plan(SENSORS["bracket"], 1.0)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_light_far_beyond_all_readings_has_an_estimate(noise):
    sensor = jl.Sensor(bit_depth=2, read_noise=noise, frames=4, gain=1e18, max_intensity=1e18)
    readings = sensor.expose(np.full((8, 8), 0.4, np.float32), rng=0)
    estimate = jl.mle(readings)
    assert np.all((estimate >= 0) & (estimate <= 1e18))
    jl.uncertainty(readings, method="mle")
