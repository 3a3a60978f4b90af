"""Equivalent counts: their maximum and information, and what takes them."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.merge_readings import counts_at_maximum
from jotlight.estimators.readings.joint_mle import maximize, regular_maximum
from jotlight.estimators.readings.reference_sensors import reference_sensor
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.likelihood.likelihood import Likelihood

BRACKET = {"frames": 48, "gain": np.repeat([1 / 64, 1 / 8, 1.0], 16), "max_intensity": 900.0}
SENSORS = [
    jl.Sensor(**BRACKET),
    jl.Sensor(**BRACKET, dark_counts=0.02, efficiency=0.5),
    jl.Sensor(frames=48, gain=96.0, threshold=np.repeat([1, 4, 20], 16), max_intensity=30.0),
    jl.Sensor(
        frames=8,
        oversampling=2,
        gain=60.0,
        threshold=np.random.default_rng(0).integers(1, 6, (40, 40)),
        mask=np.random.default_rng(1).random((40, 40)) < 0.1,
        dark_counts=np.random.default_rng(2).uniform(0, 0.1, (40, 40)),
    ),
]


def expose(sensor, rng=0):
    side = 40 // sensor.oversampling
    levels = np.geomspace(1e-4, 0.9, side * side) * sensor.max_intensity
    return sensor.expose(levels.reshape(side, side), rng=rng)


def reference_likelihood(merged):
    return Likelihood(
        merged.ones,
        merged.trials,
        efficiency=merged.efficiency,
        dark_counts=merged.dark_counts,
    )


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_the_likelihood_has_the_same_maximum_and_the_same_information(sensor):
    bits = expose(sensor)
    joint = joint_likelihood(bits, sensor, None)
    ones, trials = counts_at_maximum(joint, reference_sensor(sensor), regular_maximum(joint))
    merged = jl.merge_readings(bits)
    assert merged.sensor == reference_sensor(sensor)
    estimate = maximize(joint)
    inside = (estimate > 0) & (estimate < sensor.max_intensity) & (joint.trials > 0)
    np.testing.assert_allclose(jl.mle(merged)[inside], jl.mle(bits)[inside], rtol=2e-5)
    light = merged.sensor.light_per_intensity
    one = Likelihood(
        np.zeros(trials.shape, int),
        np.where(trials > 0, trials, 1),
        efficiency=merged.efficiency,
        dark_counts=merged.dark_counts,
    )
    information = light**2 * one.information(light * estimate)
    expected = joint.information(estimate)
    np.testing.assert_allclose(information[inside], expected[inside], rtol=1e-8)
    assert (ones <= trials).all()
    assert (trials[joint.trials == 0] == 0).all()
    # Rounding changes the trials by half a one at most.
    close = inside & (ones > 2)
    ratio = merged.trials[close] / trials[close]
    assert (abs(ratio - 1) <= 0.5 / ones[close] + 1e-9).all()


@pytest.mark.parametrize("read_noise", [0.0, 0.15])
def test_bright_pixels_with_less_than_half_a_one_stay_bright(read_noise):
    sensor = jl.Sensor(
        frames=16, gain=np.repeat([1.0, 1e-3], 8), max_intensity=1e5, read_noise=read_noise
    )
    bits = np.repeat([True, False], 8)[:, None, None]
    bits = jl.Bits.from_array(np.concatenate([bits, np.zeros_like(bits)], axis=2), sensor)
    merged = jl.merge_readings(bits)
    assert merged.ones.tolist() == [[1, 0]]
    np.testing.assert_allclose(jl.mle(merged), jl.mle(bits), rtol=1e-5)


def test_with_read_noise_pixels_that_may_be_dark_keep_their_trials():
    sensor = jl.Sensor(**BRACKET, read_noise=0.2)
    bits = sensor.expose(np.zeros((40, 40)), rng=0)
    joint = joint_likelihood(bits, sensor, None)
    ones, trials = counts_at_maximum(joint, reference_sensor(sensor), regular_maximum(joint))
    rounded = (ones > 0) & (ones < 0.5)
    assert rounded.any()
    merged = jl.merge_readings(bits)
    assert (merged.ones[rounded] == 0).all()
    np.testing.assert_array_equal(merged.trials[rounded], trials[rounded])


@pytest.mark.parametrize("sensor", SENSORS[:2], ids=repr)
def test_the_slope_at_the_lower_end_is_that_of_all_readings(sensor):
    bits = expose(sensor)
    joint = joint_likelihood(bits, sensor, None)
    merged = jl.merge_readings(bits)
    dark = joint.total == 0
    assert dark.any()
    light = merged.sensor.light_per_intensity
    slope = light * reference_likelihood(merged).gradient_and_curvature(0.0)[0]
    np.testing.assert_allclose(slope[dark], joint.gradient_and_curvature(0.0)[0][dark], rtol=1e-6)
    assert (merged.ones[dark] == 0).all()


def test_saturated_pixels_stay_saturated():
    sensor = jl.Sensor(**BRACKET)
    merged = jl.merge_readings(jl.Bits.from_array(np.ones((48, 2, 2), bool), sensor))
    np.testing.assert_array_equal(merged.ones, merged.trials)
    # Half a zero among the 16 least sensitive readings.
    assert 10 < merged.trials[0, 0] < 17


def test_the_trials_of_a_bracket_lie_between_those_of_its_exposures_and_of_all_light():
    merged = jl.merge_readings(expose(SENSORS[0]))
    assert merged.trials.max() == pytest.approx(16 * (1 + 8 + 64), rel=1e-6)
    assert merged.trials.min() > 15.5


def test_equal_readings_keep_their_counts():
    sensor = jl.Sensor(frames=9, dark_counts=0.1)
    bits = sensor.expose(np.full((5, 6), 0.4), rng=0)
    merged = jl.merge_readings(bits)
    np.testing.assert_array_equal(merged.ones, bits.counts())
    assert merged.sensor == sensor
    assert np.max(merged.trials) == 9
    of_counts = jl.merge_readings(bits.counts(), sensor)
    np.testing.assert_array_equal(of_counts.ones, merged.ones)
    dark_counts = np.arange(16.0).reshape(4, 4) / 100
    differing = jl.Sensor(oversampling=2, frames=20, threshold=2, dark_counts=dark_counts)
    with pytest.raises(ValueError, match=r"counts: expected bits, because .* efficiency or dark"):
        jl.merge_readings(np.ones((2, 2), int), differing)
    seen = differing.expose(np.full((2, 2), 0.7), rng=0)
    np.testing.assert_allclose(jl.mle(jl.merge_readings(seen)), jl.mle(seen), rtol=1e-5)


def test_colors_and_stacks_are_merged():
    sensor = SENSORS[0]
    scenes = np.random.default_rng(0).random((3, 8, 9))
    color = sensor.expose(scenes, rng=0, channel_axis=0)
    merged = jl.merge_readings(color)
    assert merged.shape == (8, 9, 3)
    np.testing.assert_allclose(jl.mle(merged), jl.mle(color), rtol=2e-5)
    stack = jl.merge_readings(sensor.expose(scenes, rng=0))
    assert [one.shape for one in stack] == [(8, 9)] * 3


@pytest.mark.parametrize("units", ["photons", "photons-per-second"])
@pytest.mark.parametrize(
    "sensor", [*SENSORS[2:], jl.Sensor(frames=4, bit_depth=4, gain=24.0, efficiency=0.5)], ids=repr
)
def test_photons_are_those_of_the_readings(sensor, units):
    data = expose(sensor.replace(exposure_time=1e-3))
    merged = jl.merge_readings(data)
    shared = {"method": "mle", "units": units}
    expected = jl.reconstruct(data, **shared)
    np.testing.assert_allclose(jl.reconstruct(merged, **shared), expected, rtol=1e-4)
    stack = jl.reconstruct([merged, merged], **shared)
    np.testing.assert_allclose(stack, [expected, expected], rtol=1e-4)
    known, plain = jl.uncertainty(merged, **shared), jl.uncertainty(merged, method="mle")
    factor = expected.max() / jl.mle(data).max()
    np.testing.assert_allclose(known.high, factor * plain.high, rtol=1e-4)


def test_a_merged_bracket_has_no_units_of_photons():
    color = SENSORS[0].expose(np.full((2, 2, 3), 0.5), rng=0, channel_axis=-1)
    for merged in (jl.merge_readings(expose(SENSORS[0])), jl.merge_readings(color)):
        for function in (jl.reconstruct, jl.uncertainty):
            with pytest.raises(ValueError, match='units: expected "intensity", because the frame'):
                function(merged, method="mle", units="photons")


@pytest.mark.slow
def test_all_methods_take_the_result():
    merged = jl.merge_readings(expose(SENSORS[0]))
    for method in (jl.admm_tv, jl.noniterative, jl.mle_iterative):
        assert method(merged).shape == (40, 40)


def test_the_spread_of_the_estimates_is_that_which_the_information_states():
    sensor = jl.Sensor(frames=600, gain=np.repeat([1 / 8, 1.0, 8.0], 200), max_intensity=90.0)
    for intensity in (0.5, 4.0):
        bits = sensor.expose(np.full((60, 60), intensity), rng=1)
        information = float(joint_likelihood(bits, sensor, None).information(intensity)[0, 0])
        spread = float(jl.mle(bits).std())
        # The standard deviation of 3,600 estimates is known to 1.2 %: four times that, and bias.
        assert spread == pytest.approx(information**-0.5, rel=0.06)


def test_dark_counts_that_saturate_the_reference_leave_no_trials():
    rng = np.random.default_rng(0)
    dark = rng.uniform(0, 70_000, (16, 16)).astype(np.float32)
    sensor = jl.Sensor(frames=4, oversampling=2, threshold=65_535, gain=262_140.0, dark_counts=dark)
    merged = jl.merge_readings(sensor.expose(rng.random((8, 8)), rng=0))  # no warning
    assert (merged.ones >= 0).all()
    assert (merged.ones <= merged.trials).all()
    assert (np.asarray(merged.trials) == 0).any()
