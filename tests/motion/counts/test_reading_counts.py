"""Readings of several bits, and brackets, along a motion: counts of them, and merged counts."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.inverse_response import equivalent_fractions
from jotlight.formats.capture import CountStack
from jotlight.motion.counts.reading_counts import ReadingCounts, counts_of_readings
from jotlight.motion.films.estimates import FilmEstimates
from jotlight.motion.films.film import film
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.likelihood.multibit import reading_probability
from jotlight.sensing.parameters.provenance import Provenance

FRAMES, SHAPE = 64, (96, 112)
SENSORS = [
    jl.Sensor(frames=FRAMES, gain=64.0, bit_depth=2),
    jl.Sensor(frames=FRAMES, gain=256.0, bit_depth=2),  # many saturated readings
    jl.Sensor(frames=FRAMES, gain=32.0, bit_depth=4, read_noise=0.3, dark_counts=0.05),
    jl.Sensor(frames=FRAMES, gain=640.0, bit_depth=8, read_noise=0.2, efficiency=0.5),
]
BRACKETS = [
    jl.Sensor(frames=FRAMES, gain=np.tile([0.3, 3.0], FRAMES // 2)),
    jl.Sensor(frames=99, gain=np.tile([1.0, 8.0, 64.0], 33), dark_counts=0.02),
    jl.Sensor(frames=FRAMES, gain=96.0, threshold=np.tile([1, 4], FRAMES // 2)),
    jl.Sensor(frames=FRAMES, read_noise=0.3),  # one exposure
    jl.Sensor(frames=FRAMES, gain=np.tile([0.2, 2.0], FRAMES // 2), bit_depth=3, read_noise=0.2),
]
FAST = BRACKETS[0]
"""The sensor whose moving scene the fast tests show."""
SLOW = SENSORS[2], BRACKETS[1], BRACKETS[4]
"""Sensors with the peculiarities of the others, whose moving scenes the slow tests show."""


def marks(sensor):
    is_slow = any(sensor is each for each in SLOW)
    return [] if sensor is FAST else [pytest.mark.slow if is_slow else pytest.mark.exhaustive]


def scene_of(sensor, motion="shake", shape=SHAPE, color=False):
    photograph = jl.datasets.photograph("astronaut" if color else "camera").astype(float)
    scene = jl.datasets.moving(photograph, motion, sensor=sensor, shape=shape, rng=1)
    # Frames of a scene are drawn whenever they are read, which takes long.
    kept, (_, _, width) = scene.bits, scene.bits.shape[:3]
    if isinstance(kept, jl.Bits):
        scene.bits = jl.Bits(np.asarray(kept.packed), width, kept.sensor)
    else:
        scene.bits = Readings(kept.to_array(), kept.sensor)
    return scene


def flat(sensor, intensity=0.6, shape=SHAPE):
    return sensor.expose(np.full(shape, intensity), rng=0)


def psnr(estimate, truth):
    inner = slice(8, -8), slice(8, -8)
    return jl.metrics.psnr(estimate[inner], truth[inner], data_range=1.0)


def whole(converted):
    """Return the merged counts of all frames without motion."""
    counts = converted.counts
    return jl.Merged(counts.sum(), np.full(SHAPE, float(counts.total_trials)), converted.sensor)


@pytest.mark.parametrize("bit_depth", [4, 8])
def test_the_photons_of_poisson_readings_become_binomial_ones(bit_depth):
    sensor = SENSORS[0].replace(bit_depth=bit_depth)
    converted = ReadingCounts(flat(sensor), sensor)
    n, rate = converted.trials, 0.6
    readings = np.arange(2**bit_depth)
    probability = reading_probability(readings, rate, bit_depth=bit_depth)
    p = -np.expm1(-rate / n)
    # The mean is exact. Random rounding replaces a part of the variance.
    ones = n * (1 - (1 - 1 / n) ** readings)
    assert probability @ ones == pytest.approx(n * p, rel=1e-6)
    counts = np.asarray(converted.counts.images[:FRAMES])
    noise = np.sqrt(n * p * (1 - p) / counts.size)
    assert abs(counts.mean() - n * p) < 5 * noise
    assert counts.var() == pytest.approx(n * p * (1 - p), rel=0.15)


@pytest.mark.parametrize("sensor", BRACKETS[:4], ids=repr)
def test_the_counts_of_a_bracket_are_sums_over_cycles(sensor):
    bits = flat(sensor, shape=(12, 20))
    converted = counts_of_readings(bits, None)
    cycle = converted.cycle
    assert len(converted.counts) == len(bits) // cycle
    assert converted.counts.trials == cycle
    counts = np.asarray(converted.counts.images[5:9])
    expected = bits.to_array()[5 * cycle : 9 * cycle].reshape(4, cycle, 12, 20).sum(axis=1)
    np.testing.assert_array_equal(counts, expected)


@pytest.mark.parametrize("sensor", [SENSORS[3], BRACKETS[2], BRACKETS[3]], ids=repr)
def test_photons_of_corrected_counts_are_those_of_a_frame(sensor):
    converted = counts_of_readings(flat(sensor), None)
    merged = converted.correct(whole(converted))
    photons = jl.reconstruct(merged, method="mle", units="photons").mean()
    assert photons == pytest.approx(0.6 * sensor.efficiency * sensor.gain / sensor.frames, rel=0.02)


@pytest.mark.parametrize("threshold", [16, [15, 17] * 16], ids=str)
def test_darkness_below_high_thresholds_has_about_as_many_trials_as_readings(threshold):
    noise = 0.3 if threshold == 16 else 0.0
    sensor = jl.Sensor(frames=32, threshold=threshold, gain=32.0, read_noise=noise)
    converted = counts_of_readings(flat(sensor), None)
    merged = converted.correct(whole(converted))
    assert merged.ones.sum() < 0.5 * merged.ones.size
    assert 16 < np.median(merged.trials) < 80


def test_saturated_pixels_have_no_part_of_a_zero():
    sensor = jl.Sensor(frames=16, gain=32.0, threshold=2, read_noise=0.3, max_intensity=8.0)
    converted = counts_of_readings(flat(sensor, 8.0), None)
    merged = converted.correct(whole(converted))
    np.testing.assert_array_equal(merged.ones, merged.trials)


def test_corrected_counts_of_a_bracket_have_no_units_of_photons():
    converted = counts_of_readings(flat(BRACKETS[0]), None)
    assert converted.correct(whole(converted)).light_share is None


@pytest.mark.parametrize("sensor", [*SENSORS, *BRACKETS], ids=repr)
@pytest.mark.parametrize("intensity", [0.05, pytest.param(0.6, marks=pytest.mark.slow)])
def test_corrected_counts_have_no_bias_and_state_their_noise(sensor, intensity):
    converted = counts_of_readings(flat(sensor, intensity), None)
    merged = converted.correct(whole(converted))
    counted = count_pixels(merged, merged.sensor, None)
    fraction = equivalent_fractions(counted, None)
    rate = merged.sensor.light_per_intensity * intensity
    rate = rate * float(np.mean(counted.efficiency)) + float(np.mean(counted.dark_counts))
    p = -np.expm1(-rate)
    trials = np.asarray(merged.trials)
    noise = np.sqrt(p * (1 - p) / trials.sum())
    assert abs(np.sum(fraction * trials) / trials.sum() - p) < 5 * noise + 0.01 * p
    # The trials state the variance.
    assert fraction.var() == pytest.approx(p * (1 - p) / trials.mean(), rel=0.35)


@pytest.mark.parametrize("frames", [48, 49, 50])
def test_an_incomplete_cycle_at_the_end_makes_no_bias(frames):
    """Its frames are not counted, so the light of a frame is that of whole cycles alone."""
    sensor = jl.Sensor(frames=frames, gain=np.resize([0.1, 0.1, 2.0], frames))
    intensity = 0.6
    converted = counts_of_readings(flat(sensor, intensity), None)
    assert len(converted.counts) == 16
    merged = converted.correct(whole(converted))
    # The mean gain of a whole cycle is 2.2 / 3.
    assert converted.sensor.light_per_intensity == pytest.approx(2.2 / 3)
    rate = -np.log1p(-merged.ones.sum() / np.sum(merged.trials))
    # A standard error of the mean is 0.2 %.
    assert rate / merged.sensor.light_per_intensity == pytest.approx(intensity, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("read_noise", "error"), [(0.0, 0.08), (0.3, 0.25)])
def test_hot_jots_make_no_bias_in_brackets(read_noise, error):
    hot = np.random.default_rng(0).random(SHAPE) < 0.02
    sensor = jl.Sensor(
        frames=FRAMES,
        gain=np.tile([1.0, 16.0], FRAMES // 2),
        read_noise=read_noise,
        dark_counts=np.where(hot, 2.0, 0.01),
    )
    found = []
    # The noise of the hot jots of one draw is 11 %. Over 150 draws, they are 4 % too dark.
    for seed in range(16):
        converted = counts_of_readings(sensor.expose(np.full(SHAPE, 0.3), rng=seed), None)
        merged = converted.correct(whole(converted))
        dark, trials = (np.asarray(each) for each in (merged.dark_counts, merged.trials))
        assert dark.min() >= 0
        for own in (hot, ~hot):
            rate = -np.log1p(-merged.ones[own].sum() / trials[own].sum()) - dark[own].mean()
            found.append(rate / merged.sensor.light_per_intensity)
    # With read noise, hot jots have two equivalent trials, which whole numbers of ones bias.
    assert np.mean(found[::2]) == pytest.approx(0.3, rel=error)
    assert np.mean(found[1::2]) == pytest.approx(0.3, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensor",
    [pytest.param(each, marks=marks(each), id=repr(each)) for each in [*SENSORS, *BRACKETS]],
)
def test_a_moving_scene_is_about_as_good_as_one_that_stands_still(sensor):
    scene = scene_of(sensor)
    motion = jl.align(scene.bits)
    merged = jl.merge(scene.bits)
    assert merged.sensor.bit_depth == 1
    estimate, truth = jl.reconstruct(merged), scene.image(motion.reference)
    still = scene_of(sensor, "static")
    best = psnr(jl.reconstruct(still.bits), still.image())
    # A part of the image is out of view in some frames.
    assert psnr(estimate, truth) > best - 4
    assert psnr(estimate, truth) > psnr(jl.reconstruct(scene.bits), truth) + 3
    again = jl.merge(scene.bits, motion=motion)
    np.testing.assert_array_equal(merged.ones, again.ones)


def test_a_frame_has_the_same_counts_whenever_it_is_read():
    converted = ReadingCounts(flat(SENSORS[2]), SENSORS[2])
    images = converted.counts.images
    np.testing.assert_array_equal(images[10:20][3:5], images[13:15])
    part = converted.counts[13:15]
    np.testing.assert_array_equal(np.asarray(part.images), np.asarray(images[13:15]))


@pytest.mark.slow
def test_stacks_of_counts_with_such_a_sensor_are_the_same():
    readings = scene_of(SENSORS[2]).bits
    stack = CountStack(readings.to_array(), Provenance("npy", "a.npy"), sensor=SENSORS[2])
    expected = jl.merge(readings)
    np.testing.assert_array_equal(jl.merge(stack, SENSORS[2]).ones, expected.ones)
    assert counts_of_readings(jl.Bits.from_array(np.zeros((2, 4, 8), int)), None) is None


@pytest.mark.slow
def test_films_and_the_film_network_take_readings():
    scene = scene_of(SENSORS[1], shape=(64, 80))
    estimates = FilmEstimates()
    for image in film(scene.bits, window=48, step=16):
        truth = scene.image(image.time)
        assert image.data is image.merged
        by_medium = psnr(jl.reconstruct(image.data), truth)
        assert by_medium > psnr(jl.reconstruct(scene.bits), truth) + 2
        # Its layers for more than 512 readings once made the second image 10 dB worse.
        assert psnr(estimates.add(image), truth) > by_medium - 1


@pytest.mark.slow
def test_colors_have_one_motion():
    sensor = jl.Sensor(frames=32, gain=64.0, bit_depth=4)
    scene = scene_of(sensor, shape=(64, 80), color=True)
    merged = jl.merge(scene.bits)
    assert merged.shape == (64, 80, 3)
    assert psnr(jl.reconstruct(merged), scene.image()) > 28


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"oversampling": 2}, "expected pixels of one jot .* got an oversampling of 2"),
        ({"mosaic": "CMYG"}, "expected ideal filters R, G, and B to merge"),
        ({"gain": np.repeat([1.0, 2.0], 8)}, r"bits\[:8\] \(--frame-range 0:8\)"),
    ],
)
def test_what_the_motion_does_not_take(changes, message):
    sensor = jl.Sensor(frames=16, bit_depth=3, **changes)
    readings = Readings(np.zeros((16, 8, 8), int), sensor)
    with pytest.raises(ValueError, match=message):
        jl.merge(readings)


@pytest.mark.slow
def test_times_of_a_bracket_are_those_of_frames():
    scene = scene_of(BRACKETS[1], shape=(64, 80))
    motion = jl.align(scene.bits)
    assert motion.times[0] >= 1
    assert motion.times[-1] <= 97
    assert motion.reference == 49  # the middle of the cycle in the middle
    for time in (4, 90):
        error = motion.at(time) - scene.motion(time, 49)
        assert np.sqrt((error**2).mean()) < 0.2
    early = jl.align(scene.bits, at=0)
    assert early.reference == 0
    error = early.at(60) - scene.motion(60, 0)
    assert np.sqrt((error**2).mean()) < 0.4
    merged = jl.merge(scene.bits, at=20.0)
    np.testing.assert_array_equal(
        merged.ones, jl.merge(scene.bits, at=20.0, motion=jl.align(scene.bits)).ones
    )
    assert psnr(jl.reconstruct(merged), scene.image(20)) > 28


@pytest.mark.slow
@pytest.mark.parametrize("causal", [False, True])
def test_films_of_brackets_have_times_in_frames(causal):
    scene = scene_of(BRACKETS[1], shape=(64, 80))
    estimates, by_medium, by_network = FilmEstimates(), [], []
    images = list(film(scene.bits, window=48, step=12, causal=causal))
    assert [image.start for image in images] == [0, 12, 24, 36, 48]
    for image in images:
        assert image.time == image.start + (46 if causal else 25)
        truth = scene.image(image.time)
        by_medium.append(psnr(jl.reconstruct(image.data), truth))
        by_network.append(psnr(estimates.add(image), truth))
    assert np.mean(by_medium) > psnr(jl.reconstruct(scene.bits), scene.image()) + 5
    assert np.mean(by_network) > np.mean(by_medium) - 0.2


def test_a_bracket_without_a_cycle_is_refused_with_advice():
    sensor = jl.Sensor(frames=48, gain=np.repeat([1.0, 8.0, 64.0], 16))
    bits = flat(sensor, shape=(32, 32))
    with pytest.raises(ValueError, match=r"expected exposures that repeat .* bits\[:16\]"):
        jl.merge(bits)
    jl.align(bits[:16])
    with pytest.raises(ValueError, match="window: expected a multiple of 3"):
        film(BRACKETS[1].expose(np.full((32, 32), 0.5), rng=0), window=16)


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=48, bit_depth=3, read_noise=0.2, mosaic="RGGB"),
        jl.Sensor(frames=96, gain=np.tile([0.3, 2.0], 48), mosaic="RGGB"),
    ],
    ids=repr,
)
def test_colors_of_readings_behind_a_mosaic_are_merged_and_filmed(sensor):
    scene = scene_of(sensor, color=True)
    motion = jl.align(scene.bits)
    merged = jl.merge(scene.bits, motion=motion)
    truth = scene.image(motion.reference)
    estimate = jl.reconstruct(merged)
    assert psnr(estimate, truth) > 27
    assert psnr(estimate, truth) > psnr(jl.reconstruct(scene.bits), truth) + 8
    assert abs(estimate.mean() / truth.mean() - 1) < 0.02
    cycle = len(scene.bits) // 48
    images = list(film(scene.bits, window=32 * cycle, step=8 * cycle, causal=True))
    last = images[-1]
    assert last.data is last.merged
    assert psnr(jl.reconstruct(last.data), scene.image(last.time)) > 26


@pytest.mark.slow
def test_a_scene_behind_a_mosaic_that_stands_still_is_filmed_from_its_readings():
    sensor = jl.Sensor(frames=96, gain=np.tile([0.3, 2.0], 48), mosaic="RGGB")
    scene = scene_of(sensor, "static", shape=(64, 80), color=True)
    image = list(film(scene.bits, window=64, step=16))[1]
    assert image.motion.model == "none"
    assert image.start == 16
    np.testing.assert_array_equal(image.data.to_array(), scene.bits[16:80].to_array())
    assert image.data.sensor == scene.bits[16:80].sensor
