"""Readings of several bits along a motion: spread over trials, and merged counts of them."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.inverse_response import equivalent_fractions
from jotlight.formats.capture import CountStack
from jotlight.motion.film import film
from jotlight.motion.film_estimates import FilmEstimates
from jotlight.motion.spread import SpreadReadings, spread_readings
from jotlight.sensing.multibit import reading_probability
from jotlight.sensing.photon_readings import Readings
from jotlight.sensing.pixel_counts import count_pixels
from jotlight.sensing.provenance import Provenance

FRAMES, SHAPE = 64, (96, 112)
SENSORS = [
    jl.Sensor(frames=FRAMES, gain=64.0, bit_depth=2),
    jl.Sensor(frames=FRAMES, gain=256.0, bit_depth=2),  # many saturated readings
    jl.Sensor(frames=FRAMES, gain=32.0, bit_depth=4, read_noise=0.3, dark_counts=0.05),
    jl.Sensor(frames=FRAMES, gain=640.0, bit_depth=8, read_noise=0.2, efficiency=0.5),
]


def scene_of(sensor, motion="shake", shape=SHAPE, color=False):
    photograph = jl.datasets.photograph("astronaut" if color else "camera").astype(float)
    return jl.datasets.moving(photograph, motion, sensor=sensor, shape=shape, rng=1)


def flat(sensor, intensity=0.6, shape=SHAPE):
    return sensor.expose(np.full(shape, intensity), rng=0)


def psnr(estimate, truth):
    inner = slice(8, -8), slice(8, -8)
    return jl.metrics.psnr(estimate[inner], truth[inner], data_range=1.0)


def whole(spread):
    """Return the merged counts of all frames without motion."""
    counts = spread.counts
    return jl.Merged(counts.sum(), np.full(SHAPE, float(counts.total_trials)), spread.sensor)


@pytest.mark.parametrize("bit_depth", [4, 8])
def test_the_photons_of_poisson_readings_become_binomial_ones(bit_depth):
    sensor = SENSORS[0].replace(bit_depth=bit_depth)
    spread = SpreadReadings(flat(sensor), sensor)
    n, rate = spread.trials, 0.6
    readings = np.arange(2**bit_depth)
    probability = reading_probability(readings, rate, bit_depth=bit_depth)
    p = -np.expm1(-rate / n)
    # The mean is exact. Random rounding replaces a part of the variance.
    ones = n * (1 - (1 - 1 / n) ** readings)
    assert probability @ ones == pytest.approx(n * p, rel=1e-6)
    counts = np.asarray(spread.counts.images[:FRAMES])
    noise = np.sqrt(n * p * (1 - p) / counts.size)
    assert abs(counts.mean() - n * p) < 5 * noise
    assert counts.var() == pytest.approx(n * p * (1 - p), rel=0.15)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_the_response_is_that_of_direct_sums(sensor):
    spread = SpreadReadings(flat(sensor), sensor)
    table, n = spread.response, spread.trials
    readings = np.arange(sensor.max_reading + 1)
    low = np.floor(n * (1 - (1 - 1 / n) ** readings))
    share = n * (1 - (1 - 1 / n) ** readings) - low
    for index in (0, 100, 400):
        options = {"bit_depth": sensor.bit_depth, "read_noise": sensor.read_noise}
        probability = reading_probability(readings, table.rates[index], **options)
        mean = probability @ ((1 - share) * low + share * (low + 1))
        square = probability @ ((1 - share) * low**2 + share * (low + 1) ** 2)
        assert table.mean[index] == pytest.approx(mean / n, rel=1e-6)
        assert table.variance[index] == pytest.approx((square - mean**2) / n**2, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
@pytest.mark.parametrize("intensity", [0.05, 0.6])
def test_corrected_counts_have_no_bias_and_state_their_noise(sensor, intensity):
    spread = SpreadReadings(flat(sensor, intensity), sensor)
    merged = spread.correct(whole(spread))
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


@pytest.mark.parametrize(
    "sensor",
    [
        pytest.param(each, marks=[pytest.mark.slow] * (each.bit_depth in (4, 8)), id=repr(each))
        for each in SENSORS
    ],
)
def test_a_moving_scene_is_about_as_good_as_one_that_stands_still(sensor):
    scene = scene_of(sensor)
    merged = jl.merge(scene.bits)
    assert merged.sensor.bit_depth == 1
    estimate = jl.reconstruct(merged)
    still = scene_of(sensor, "static")
    best = psnr(jl.reconstruct(still.bits), still.image())
    # A part of the image is out of view in some frames.
    assert psnr(estimate, scene.image()) > best - 3
    assert psnr(estimate, scene.image()) > psnr(jl.reconstruct(scene.bits), scene.image()) + 3
    motion = jl.align(scene.bits)
    again = jl.merge(scene.bits, motion=motion)
    np.testing.assert_array_equal(merged.ones, again.ones)


def test_a_frame_has_the_same_counts_whenever_it_is_read():
    spread = SpreadReadings(flat(SENSORS[2]), SENSORS[2])
    images = spread.counts.images
    np.testing.assert_array_equal(images[10:20][3:5], images[13:15])
    part = spread.counts[13:15]
    np.testing.assert_array_equal(np.asarray(part.images), np.asarray(images[13:15]))


def test_stacks_of_counts_with_such_a_sensor_are_the_same():
    readings = scene_of(SENSORS[2]).bits
    stack = CountStack(readings.to_array(), Provenance("npy", "a.npy"), sensor=SENSORS[2])
    expected = jl.merge(readings)
    np.testing.assert_array_equal(jl.merge(stack, SENSORS[2]).ones, expected.ones)
    assert spread_readings(jl.Bits.from_array(np.zeros((2, 4, 8), int)), None) is None


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


def test_colors_have_one_motion():
    sensor = jl.Sensor(frames=32, gain=64.0, bit_depth=4)
    scene = scene_of(sensor, shape=(64, 80), color=True)
    merged = jl.merge(scene.bits)
    assert merged.shape == (64, 80, 3)
    assert psnr(jl.reconstruct(merged), scene.image()) > 28


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"oversampling": 2}, "expected an oversampling of 1"),
        ({"mosaic": "RGGB"}, "expected no mosaic for the motion in readings"),
        ({"gain": np.repeat([1.0, 2.0], 8)}, r"bits\[:8\] \(--frame-range 0:8\)"),
    ],
)
def test_what_the_motion_does_not_take(changes, message):
    sensor = jl.Sensor(frames=16, bit_depth=3, **changes)
    readings = Readings(np.zeros((16, 8, 8), int), sensor)
    with pytest.raises(ValueError, match=message):
        jl.align(readings)
