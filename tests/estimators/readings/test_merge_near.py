"""Equivalent counts near known intensities: no bias, and trials that do not depend on noise."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.readings import merge_near as merge_near_module
from jotlight.estimators.readings.merge_near import Merging
from jotlight.estimators.readings.reference_sensors import reference_sensor
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.merged import MAX_SILENT_TRIALS
from jotlight.sensing.parameters.mosaic import Mosaic

SHAPE = 80, 90
GAINS = np.array([1.0, 2.0, 3.0, 4.0])


def merged_near(sensor, intensity, rng=0, assumed=None):
    bits = sensor.expose(np.full(SHAPE, intensity), rng=rng)
    near = np.full(SHAPE, intensity if assumed is None else assumed)
    return bits, Merging(joint_likelihood(bits, sensor, None)).near(near)


def test_bits_of_a_bracket_have_the_counts_of_the_formula():
    sensor, x = jl.Sensor(frames=4, gain=GAINS), 0.6
    bits, merged = merged_near(sensor, x)
    rates = GAINS * x
    own = -np.expm1(-rates)
    slopes = GAINS * np.exp(-rates)
    light = reference_sensor(sensor).gain / 4
    p, slope = -np.expm1(-light * x), light * np.exp(-light * x)
    information = np.sum(slopes**2 / (own * (1 - own)))
    trials = information * p * (1 - p) / slope**2
    weights = slopes / (own * (1 - own)) * p * (1 - p) / slope
    ones = trials * p + np.tensordot(weights, bits.to_array() - own[:, None, None], axes=1)
    # Rounding keeps the sum of each row, as far as no debt is forgotten.
    assert (ones < 0).any()
    assert merged.ones.sum() == pytest.approx(ones.sum(), rel=0.01)
    assert merged.trials.sum() == pytest.approx(trials * ones.size, rel=0.01)


@pytest.mark.parametrize("assumed", [0.2, 2.0])
def test_counts_of_many_readings_are_right_far_from_the_given_intensity(assumed):
    # At an edge, the average of the neighbors is far from both sides.
    sensor, x = jl.Sensor(frames=900, gain=np.repeat([0.5, 2.0, 8.0], 300)), 0.6
    _, merged = merged_near(sensor, x, assumed=assumed)
    found = jl.mle(merged)
    assert found.mean() == pytest.approx(x, rel=0.01)
    # The noise is that of the readings: the Cramér-Rao bound.
    rates = np.array([0.5, 2.0, 8.0]) * x
    information = 300 * np.sum((rates / x) ** 2 * np.exp(-rates) / -np.expm1(-rates))
    assert found.std() == pytest.approx(information**-0.5, rel=0.1)


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=4, gain=GAINS),
        jl.Sensor(frames=3, gain=[0.5, 2.0, 8.0]),
        jl.Sensor(frames=2, gain=4.0, threshold=[1, 2]),
        jl.Sensor(bit_depth=2, gain=2.0),
        jl.Sensor(frames=4, gain=4.0, bit_depth=3, read_noise=0.3),
    ],
    ids=repr,
)
def test_a_few_readings_have_no_bias(sensor):
    x = 0.6
    bits, merged = merged_near(sensor, x)
    reference = merged.sensor
    p = -np.expm1(-(reference.light_per_intensity * x + np.mean(merged.dark_counts)))
    found = merged.ones.sum() / merged.trials.sum()
    noise = np.sqrt(p * (1 - p) / merged.trials.sum())
    assert abs(found - p) < 5 * noise + 0.005 * p
    # The most likely intensities are biased, or their trials are.
    usual = jl.merge_readings(bits)
    fractions = usual.ones / np.maximum(usual.trials, 1e-9)
    assert np.ptp(usual.trials) > 0
    assert abs(fractions.mean() - p) > 2 * abs(found - p) or sensor.read_noise > 0


def test_the_trials_hardly_depend_on_the_noise():
    sensor = jl.Sensor(frames=12, gain=np.repeat([8.0, 1.0, 1 / 8], 4))
    _, first = merged_near(sensor, 0.5)
    _, second = merged_near(sensor, 0.5, rng=1)
    assert (first.ones != second.ones).any()
    for merged in (first, second):
        assert merged.trials.mean() == pytest.approx(first.trials.mean(), rel=0.001)
        assert np.median(abs(merged.trials - np.median(first.trials))) <= 1


@pytest.mark.parametrize("intensity", [0.3, 0.6])
def test_mostly_saturated_readings_have_no_bias(intensity):
    # Pixels of one or two trials are nearly all ones, so rounded ones exceed the trials.
    _, merged = merged_near(jl.Sensor(frames=4, gain=4 * GAINS), intensity)
    fraction = merged.ones.sum() / merged.trials.sum()
    found = -np.log1p(-fraction) / merged.sensor.light_per_intensity
    assert found == pytest.approx(intensity, rel=0.05)


@pytest.mark.parametrize(
    ("frames", "photons"), [(8, 96.0), (4, 64.0), (16, 16 * 16.0)], ids=["12", "16", "16, many"]
)
def test_averages_of_mostly_saturated_readings_have_no_bias(frames, photons):
    # At 9.6 photons, 99 % of the readings are 3, and at 12.8 photons 99.97 %.
    sensor, x = jl.Sensor(frames=frames, gain=photons, bit_depth=2), 0.8
    bits = sensor.expose(np.full((160, 180), x), rng=0)
    merged = Merging(joint_likelihood(bits, sensor, None)).near_neighbors()
    fraction = merged.ones.sum() / merged.trials.sum()
    found = -np.log1p(-fraction) / merged.sensor.light_per_intensity
    assert found == pytest.approx(x, rel=0.12)


def test_pixels_of_less_than_a_trial_are_not_dark():
    sensor, x = jl.Sensor(bit_depth=2, gain=12.0), 0.7
    bits = sensor.expose(np.full(SHAPE, x), rng=0)
    joint = joint_likelihood(bits, sensor, None)
    assert (joint.total == 3).mean() > 0.97
    merged = Merging(joint).near_neighbors()
    assert merged.trials.mean() > 0.98
    assert (merged.trials <= MAX_SILENT_TRIALS).mean() < 0.1
    found = jl.reconstruct(merged, method="network-medium")
    assert found.mean() == pytest.approx(x, rel=0.25)


def test_a_wrong_intensity_changes_the_result_less_than_it_is_wrong():
    sensor, x = jl.Sensor(frames=4, gain=GAINS), 0.6
    reference = reference_sensor(sensor)
    for assumed in (0.5, 0.72):
        _, merged = merged_near(sensor, x, assumed=assumed)
        fraction = merged.ones.sum() / merged.trials.sum()
        estimate = -np.log1p(-fraction) / reference.light_per_intensity
        assert abs(estimate / x - 1) < 0.05


def test_pixels_without_readings_have_no_counts():
    mask = np.zeros(SHAPE, bool)
    mask[::3, ::4] = True
    sensor = jl.Sensor(frames=4, gain=GAINS, mask=mask)
    _, merged = merged_near(sensor, 0.6)
    assert (merged.ones[mask] == 0).all()
    assert (np.asarray(merged.trials)[mask] == 0).all()
    assert (np.asarray(merged.trials)[~mask] > 0).all()


def test_averages_over_neighbors_are_of_the_same_filter():
    sensor = jl.Sensor(frames=4, gain=GAINS)
    pattern = np.indices(SHAPE).sum(axis=0) % 2
    light = np.where(pattern, 0.9, 0.1)
    bits = sensor.expose(light, rng=0)
    joint = joint_likelihood(bits, sensor, None)
    merged = Merging(joint).near_neighbors(Mosaic(pattern, "RGB"))
    expected = Merging(joint).near(light, pattern=pattern)
    for each in (0, 1):
        own = pattern == each
        p = -np.expm1(-merged.sensor.light_per_intensity * light[own].mean())
        found = merged.ones[own].sum() / merged.trials[own].sum()
        assert found == pytest.approx(p, rel=0.05)
        assert merged.trials[own].mean() == pytest.approx(expected.trials[own].mean(), rel=0.1)
    # Without the pattern, dark pixels would be compared with bright neighbors.
    mixed = Merging(joint).near_neighbors()
    dark = pattern == 0
    assert np.ptp([mixed.trials[dark].mean(), mixed.trials[~dark].mean()]) < 0.3 * np.ptp(
        [merged.trials[dark].mean(), merged.trials[~dark].mean()]
    )


@pytest.mark.parametrize("intensity", [0.1, 0.5])
def test_pixels_with_different_thresholds_have_a_common_average(intensity):
    board = np.where(np.indices(SHAPE).sum(axis=0) % 2, 1, 4)
    sensor = jl.Sensor(frames=8, gain=32.0, threshold=board)
    joint = joint_likelihood(sensor.expose(np.full(SHAPE, intensity), rng=0), sensor, None)
    average = merge_near_module._average(joint, 1.5, None)
    assert np.abs(average / intensity - 1).mean() < 0.15
    assert average.mean() == pytest.approx(intensity, rel=0.05)
    for own in (board == 1, board == 4):
        assert average[own].mean() == pytest.approx(intensity, rel=0.05)


@pytest.mark.parametrize("gain", [16.0, np.repeat([8.0, 0.25], 8)], ids=["one", "bracket"])
def test_maps_of_thresholds_and_of_jots_together_make_no_bias(gain):
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(
        frames=16,
        gain=gain,
        threshold=np.where(np.indices(SHAPE).sum(axis=0) % 2, 1, 3),
        dark_counts=np.where(rng.random(SHAPE) < 0.02, 2.0, rng.uniform(0, 0.2, SHAPE)),
        efficiency=rng.uniform(0.5, 1, SHAPE),
        mask=rng.random(SHAPE) < 0.02,
    )
    bits = sensor.expose(np.full(SHAPE, 0.4), rng=0)
    merged = Merging(joint_likelihood(bits, sensor, None)).near_neighbors()
    inner = merged.trials[4:-4, 4:-4]
    fraction = merged.ones[4:-4, 4:-4].sum() / inner.sum()
    light = float(merged.efficiency) * merged.sensor.light_per_intensity
    assert (-np.log1p(-fraction) - merged.dark_counts) / light == pytest.approx(0.4, rel=0.05)
    # No pixel says much more than others about a light that is the same everywhere.
    ratio = merged.ones[4:-4, 4:-4] / inner
    p = -np.expm1(-0.4 * light - merged.dark_counts)
    assert ratio.std() < 2 * np.sqrt(p * (1 - p) / inner.mean())


@pytest.mark.parametrize(("side", "noise"), [(1, 0.85), (2, 1.0)])
def test_counts_are_averaged_only_where_the_thresholds_of_pixels_differ(side, noise):
    shape = tuple(side * size for size in SHAPE)
    board = np.where(np.indices(shape).sum(axis=0) % 2, 1, 2)
    sensor = jl.Sensor(oversampling=side, frames=16, gain=16.0 * side**2, threshold=board)
    bits = sensor.expose(np.full(SHAPE, 0.8), rng=0)
    merged = Merging(joint_likelihood(bits, sensor, None)).near_neighbors()
    p = merged.ones.sum() / merged.trials.sum()
    expected = np.sqrt(p * (1 - p) / merged.trials.mean())
    assert (merged.ones / merged.trials).std() / expected == pytest.approx(noise, abs=0.1)


def test_dim_colors_behind_high_thresholds_are_not_black():
    # Green has the threshold 1, red and blue 3.
    shape = 96, 96
    board = np.where(np.indices(shape).sum(axis=0) % 2, 1, 3)
    sensor = jl.Sensor(frames=16, gain=16.0, threshold=board, mosaic="RGGB")
    bits = sensor.expose(np.full((*shape, 3), 0.2), rng=0)
    found = jl.reconstruct(bits)
    np.testing.assert_allclose(found.mean(axis=(0, 1)), 0.2, rtol=0.35)


@pytest.mark.parametrize("intensity", [0.5, 0.8])
def test_colors_tell_how_bright_saturated_clear_pixels_are(intensity):
    mosaic = Mosaic("RGBW")
    gray = jl.Sensor(bit_depth=2, gain=6.0, max_intensity=3.0)
    sensor = gray.replace(mosaic=mosaic)
    bits = sensor.expose(np.full((*SHAPE, 3), intensity), rng=0, channel_axis=-1)
    merged = Merging(joint_likelihood(bits, gray, None)).near_neighbors(mosaic)
    clear = mosaic.full(*SHAPE) == 3
    for own, light in ((~clear, intensity), (clear, 3 * intensity)):
        fraction = merged.ones[own].sum() / merged.trials[own].sum()
        found = -np.log1p(-fraction) / merged.sensor.light_per_intensity
        assert found == pytest.approx(light, rel=0.1)


def test_dim_scenes_of_jots_that_differ_have_no_bias():
    """Narrow averages of few photons are noisy. Counts near them weigh dark ones too much."""
    sensor = jl.Sensor(
        frames=4,
        gain=1.6,
        oversampling=2,
        dark_counts=np.random.default_rng(0).gamma(1, 0.02, (192, 192)),
    )
    bits = sensor.expose(np.full((96, 96), 0.5), rng=1)
    merged = Merging(joint_likelihood(bits, sensor, None)).near_neighbors()
    trials = np.broadcast_to(merged.trials, merged.shape)

    def expected(light):
        rate = merged.efficiency * merged.sensor.light_per_intensity * light + merged.dark_counts
        return float((trials * -np.expm1(-rate)).sum())

    # The mean intensity at which the sum of ones is expected: 0.37 near narrow averages.
    candidates = np.linspace(0.3, 0.7, 401)
    found = candidates[np.argmin([abs(expected(c) - merged.ones.sum()) for c in candidates])]
    assert found == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("unit", [1e-14, 1e14])
@pytest.mark.parametrize(
    "options",
    [
        {"efficiency": np.where(np.indices((16, 16))[1] % 2, 1.0, 0.3)},
        {"threshold": 1 + np.indices((16, 16)).sum(axis=0) % 3},
        {"bit_depth": 2, "read_noise": 0.3, "efficiency": np.linspace(0.3, 1, 256).reshape(16, 16)},
    ],
    ids=lambda options: next(iter(options)),
)
def test_counts_do_not_depend_on_the_unit_of_intensity(options, unit):
    sensor = jl.Sensor(oversampling=2, frames=8, gain=48.0, **options)
    data = sensor.expose(np.linspace(0.1, 0.9, 64).reshape(8, 8), rng=0)
    other = sensor.replace(gain=sensor.gain * unit, max_intensity=1 / unit)
    expected, found = (
        Merging(joint_likelihood(data, each, None)).near_neighbors() for each in (sensor, other)
    )
    np.testing.assert_array_equal(found.ones, expected.ones)
    np.testing.assert_allclose(found.trials, expected.trials, rtol=1e-6)


def test_an_efficiency_of_1e_12_counts_like_a_gain():
    threshold = 1 + np.indices((8, 8)).sum(axis=0) % 3
    sensor = jl.Sensor(frames=8, gain=16.0, threshold=threshold)
    data = sensor.expose(np.full((8, 8), 0.5), rng=0)
    other = sensor.replace(gain=16e12, efficiency=1e-12)
    expected, found = (
        Merging(joint_likelihood(data, each, None)).near_neighbors() for each in (sensor, other)
    )
    np.testing.assert_array_equal(found.ones, expected.ones)
