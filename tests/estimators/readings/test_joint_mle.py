"""Maximum likelihood of readings that differ, against brute force."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import jotlight as jl
from jotlight.estimators.readings.joint_mle import maximize, regular_maximum, solve_expected_total
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.parameters.response import detection_probability, silence_probability

RANDOM = np.random.default_rng(3)
BRACKET = {"frames": 12, "gain": np.repeat([0.05, 0.8, 9.0], 4), "max_intensity": 40.0}
SENSORS = [
    jl.Sensor(**BRACKET),
    jl.Sensor(**BRACKET, dark_counts=0.1),
    jl.Sensor(**BRACKET, threshold=2, efficiency=0.4),
    jl.Sensor(frames=6, gain=30.0, threshold=[1, 1, 4, 4, 20, 20], max_intensity=8.0),
    jl.Sensor(
        frames=2,
        oversampling=2,
        gain=30.0,
        threshold=RANDOM.integers(1, 5, (20, 20)),
        dark_counts=RANDOM.uniform(0, 0.3, (20, 20)),
        max_intensity=3.0,
    ),
]


def scene(sensor):
    side = 20 // sensor.oversampling
    levels = np.geomspace(1e-3, 2, side * side) * sensor.max_intensity
    return RANDOM.permutation(levels).reshape(side, side)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_the_estimate_is_the_maximum_that_brute_force_finds(sensor):
    bits = sensor.expose(scene(sensor), rng=0)
    estimate = jl.mle(bits)
    joint = joint_likelihood(bits, sensor, None)
    exact = maximize(joint)
    np.testing.assert_array_equal(estimate, exact.astype(np.float32))
    gradient, curvature = joint.gradient_and_curvature(exact)
    inside = (exact > 0) & (exact < sensor.max_intensity)
    assert inside.mean() > 0.3
    assert abs(gradient[inside] / curvature[inside] / exact[inside]).max() < 1e-7
    assert (gradient[exact == 0] <= 0).all()
    assert (gradient[exact == sensor.max_intensity] >= 0).all()


@pytest.mark.parametrize(
    "sensor", [SENSORS[1], pytest.param(SENSORS[3], marks=pytest.mark.slow)], ids=repr
)
def test_the_estimate_of_single_pixels_agrees_with_a_search_on_the_definition(sensor):
    bits = sensor.expose(scene(sensor), rng=1)
    estimate = jl.mle(bits)
    array = bits.to_array()
    gains = np.broadcast_to(
        sensor.gain if np.ndim(sensor.gain) else sensor.gain / sensor.frames, sensor.frames
    )
    thresholds = np.broadcast_to(sensor.threshold, sensor.frames)
    for row, column in RANDOM.integers(0, 20, (4, 2)):
        ones = array[:, row, column]

        def loss(logarithm, ones=ones):
            rate = sensor.efficiency * gains * np.exp(logarithm) + sensor.dark_counts
            pairs = zip(thresholds, rate, ones, strict=True)
            return -sum(
                np.log((detection_probability if one else silence_probability)(int(q), s))
                for q, s, one in pairs
            )

        bounds = (np.log(1e-5), np.log(sensor.max_intensity))
        grid = np.linspace(*bounds, 200)
        best, step = grid[np.argmin([loss(x) for x in grid])], grid[1] - grid[0]
        near = max(best - step, bounds[0]), min(best + step, bounds[1])
        found = minimize_scalar(loss, bounds=near, method="bounded", options={"xatol": 1e-10})
        x = max(np.exp(bounds[0]), float(estimate[row, column]))
        assert loss(np.log(x)) <= found.fun + 1e-9


def test_one_group_for_each_pixel_has_the_closed_form():
    threshold = np.where(np.indices((8, 8)).sum(axis=0) % 2, 1, 4)
    sensor = jl.Sensor(frames=20, gain=60.0, threshold=threshold, max_intensity=4.0)
    bits = sensor.expose(np.full((8, 8), 0.9), rng=0)
    estimate = jl.mle(bits)
    for q in (1, 4):
        closed = jl.mle(bits.counts(), sensor.replace(threshold=q))
        np.testing.assert_allclose(estimate[threshold == q], closed[threshold == q], rtol=1e-6)


def test_equal_values_have_the_estimates_of_one_number_bit_for_bit():
    plain = jl.Sensor(frames=6, gain=9.0, threshold=2)
    equal = jl.Sensor(frames=6, gain=np.full(6, 1.5), threshold=np.full((20, 20), 2))
    bits = plain.expose(np.full((20, 20), 0.5), rng=0)
    np.testing.assert_array_equal(equal.expose(np.full((20, 20), 0.5), rng=0).packed, bits.packed)
    np.testing.assert_array_equal(jl.mle(bits, equal), jl.mle(bits, plain))


def test_the_maximum_of_gains_that_differ_little_is_that_of_their_mean():
    sensor = jl.Sensor(frames=20, gain=np.linspace(0.999999, 1.000001, 20), max_intensity=9.0)
    plain = sensor.replace(gain=20.0)
    bits = plain.expose(scene(sensor), rng=0)
    np.testing.assert_allclose(jl.mle(bits, sensor), jl.mle(bits, plain), rtol=1e-4)


def test_dead_pixels_are_filled_and_extremes_are_reached():
    mask = np.zeros((4, 4), bool)
    mask[1, 1] = True
    sensor = jl.Sensor(frames=2, gain=[0.5, 4.0], max_intensity=3.0, mask=mask)
    ones = np.zeros((2, 4, 4), bool)
    ones[:, :, 2:] = True
    with pytest.warns(jl.JotlightWarning, match="1 of 16 pixels have no valid bit"):
        estimate = jl.mle(jl.Bits.from_array(ones), sensor)
    assert (estimate[:, 2:] == 3).all()
    assert (estimate[[0, 2, 3], :2] == 0).all()
    assert np.isfinite(estimate).all()


def test_extreme_ratios_of_gains_converge():
    sensor = jl.Sensor(frames=4, gain=[1e-9, 1e-3, 1e3, 1e9], max_intensity=1e12)
    levels = np.geomspace(1e-10, 1e11, 400).reshape(20, 20)
    joint = joint_likelihood(sensor.expose(levels, rng=0), sensor, None)
    estimate = maximize(joint)
    gradient, curvature = joint.gradient_and_curvature(estimate)
    inside = (estimate > 0) & (estimate < 1e12)
    assert abs(gradient[inside] / curvature[inside] / estimate[inside]).max() < 1e-6


def test_the_regular_maximum_expects_half_a_one_or_half_a_zero_at_the_ends():
    sensor = jl.Sensor(frames=3, gain=[0.1, 1.0, 9.0], max_intensity=1e3)
    ones = np.zeros((3, 1, 4), bool)
    ones[:, 0, 1] = True
    ones[2, 0, 2:] = True
    joint = joint_likelihood(jl.Bits.from_array(ones), sensor, None)
    regular, plain = regular_maximum(joint), maximize(joint)
    expected, *_ = joint.expected_total(regular)
    np.testing.assert_allclose(expected[0, :2], [0.5, 2.5])
    np.testing.assert_array_equal(regular[0, 2:], plain[0, 2:])
    assert solve_expected_total(joint, 5.0).max() == 1e3


def test_stacks_colors_and_lists_are_estimated_image_by_image():
    sensor = SENSORS[0]
    scenes = np.stack([scene(sensor), scene(sensor)])
    stack = sensor.expose(scenes, rng=0)
    each = [jl.mle(one) for one in stack]
    np.testing.assert_array_equal(jl.mle(stack), each)
    color = sensor.expose(scenes, rng=0, channel_axis=0)
    assert jl.mle(color).shape == (20, 20, 2)
    np.testing.assert_array_equal(jl.mle(color)[..., 0], jl.mle(color.channels()[0], sensor))


def test_a_smooth_kernel_is_treated_as_the_box_kernel():
    sensor = SENSORS[0].replace(kernel="cubic")
    with pytest.warns(jl.JotlightWarning, match="kernel"):
        jl.mle(sensor.expose(scene(sensor), rng=0))


def test_a_periodic_map_of_thresholds_is_no_mosaic():
    threshold = np.where(np.indices((256, 256)).sum(axis=0) % 2, 1, 4)
    sensor = jl.Sensor(frames=4, gain=8.0, threshold=threshold)
    bits = sensor.expose(np.full((256, 256), 0.7), rng=0)
    jl.mle(jl.Bits(bits.packed, bits.width), sensor)  # a warning would be an error
    jl.mle(bits.counts(), sensor)


def test_bits_with_read_noise_far_below_the_threshold_have_their_expected_sum():
    sensor = jl.Sensor(threshold=100, read_noise=0.3, frames=16, gain=1600, max_intensity=10)
    bits = jl.Bits.from_array(np.zeros((16, 1, 1), bool), sensor)
    light = solve_expected_total(joint_likelihood(bits, sensor, None), 0.5)
    # Read noise changes some readings only where 99 or 100 photons arrive.
    noiseless = sensor.replace(read_noise=0.0)
    bits = jl.Bits.from_array(bits.to_array(), noiseless)
    expected = solve_expected_total(joint_likelihood(bits, noiseless, None), 0.5)
    np.testing.assert_allclose(light, expected, rtol=2e-3)
    errors = [jl.uncertainty(bits, each, method="mle") for each in (sensor, noiseless)]
    np.testing.assert_allclose(*(each.standard_error for each in errors), rtol=0.02)
