"""Readings of several bits: their simulation, their class, and sensors that record them."""

import math

import numpy as np
import pytest
from scipy import stats

import jotlight as jl
from jotlight.sensing.likelihood.multibit import reading_probability
from jotlight.sensing.parameters.provenance import Provenance

IMAGE = np.linspace(0, 1, 30 * 20).reshape(30, 20)


def several_bits(**changes):
    return jl.Sensor(**{"frames": 5, "gain": 15.0, "bit_depth": 3, "oversampling": 2, **changes})


@pytest.mark.parametrize(
    "sensor",
    [
        several_bits(gain=60.0),
        several_bits(gain=800.0, bit_depth=7, kernel="linear"),
        several_bits(gain=60.0, dark_counts=np.full((60, 40), 0.3, np.float32), efficiency=0.5),
        several_bits(gain=60.0, mask=np.arange(2400).reshape(60, 40) % 7 == 0),
        several_bits(gain=[1.0, 8.0, 1.0, 8.0, 30.0]),
    ],
)
def test_readings_agree_with_the_bits_of_all_thresholds(sensor):
    readings = sensor.expose(IMAGE, rng=3).to_array()
    assert readings.max() == sensor.max_reading or sensor.bit_depth > 3
    for threshold in range(1, sensor.max_reading + 1):
        bits = sensor.replace(bit_depth=1, threshold=threshold).expose(IMAGE, rng=3)
        np.testing.assert_array_equal(readings >= threshold, bits.to_array())


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_parts_are_those_of_the_whole(noise):
    sensor = several_bits(read_noise=noise)
    whole = sensor.expose(IMAGE, rng=3)
    part = sensor.expose(
        IMAGE, rng=3, tile=(slice(5, 9), slice(7, 20)), frames=slice(2, 4), threads=1
    )
    np.testing.assert_array_equal(part.to_array(), whole.to_array()[2:4, 10:18, 14:40])
    assert part.sensor == sensor.replace(frames=2)


def test_colors_and_stacks_are_independent():
    sensor = several_bits(read_noise=0.3)
    color = sensor.expose(np.stack([IMAGE, IMAGE], -1), rng=0, channel_axis=-1)
    assert color.shape == (5, 60, 40, 2)
    first, second = color.channels()
    np.testing.assert_array_equal(first.to_array(), sensor.expose(IMAGE, rng=0).to_array())
    assert (first.to_array() != second.to_array()).mean() > 0.2
    stack = sensor.expose(np.stack([IMAGE, IMAGE]), rng=0)
    np.testing.assert_array_equal(stack[0].to_array(), first.to_array())
    assert (stack[1].to_array() != first.to_array()).mean() > 0.2


def test_the_channels_of_readings_keep_their_origin():
    origin = Provenance("npy", "a.npy")
    color = jl.Readings(np.ones((1, 4, 4, 2), int), jl.Sensor(bit_depth=2), origin)
    assert [channel.provenance for channel in color.channels()] == [origin] * 2


@pytest.mark.parametrize(
    ("light", "options"),
    [
        (0.02, {"bit_depth": 2, "read_noise": 0.3}),
        (1.0, {"bit_depth": 4, "read_noise": 0.15}),
        (5.0, {"bit_depth": 3, "read_noise": 0.5}),
        (40.0, {"bit_depth": 8, "read_noise": 2.0}),
        (300.0, {"bit_depth": 12}),
        (0.7, {"read_noise": 0.3}),
        (3.0, {"read_noise": 0.25, "threshold": 4}),
    ],
)
@pytest.mark.filterwarnings("ignore:read_noise")
def test_drawn_readings_have_the_exact_distribution(light, options):
    # Two-sided exact binomial tests of all readings together: a false alarm once in 10^6 seeds.
    frames = 400
    sensor = jl.Sensor(frames=frames, gain=frames * light, **options)
    drawn = np.asarray(sensor.expose(np.ones((40, 40)), rng=7)).astype(int).reshape(-1)
    found = np.bincount(drawn, minlength=sensor.max_reading + 1)
    probability = reading_probability(np.arange(sensor.max_reading + 1), light, **options)
    level = 1e-6 / len(found)
    low = stats.binom.cdf(found, drawn.size, probability)
    high = stats.binom.sf(found - 1, drawn.size, probability)
    assert np.minimum(low, high).min() > level / 2


def test_noise_is_independent_of_photons_frames_and_neighbors():
    sensor = jl.Sensor(frames=2, gain=2e-17, bit_depth=8, dark_counts=100.0)
    with pytest.warns(jl.JotlightWarning, match="read_noise"):
        sensor = sensor.replace(read_noise=20.0)
    values = sensor.expose(np.zeros((200, 200)), rng=1).to_array().astype(float)
    values -= values.mean()
    correlations = [
        (values[0] * values[1]).mean(),
        (values[:, :, 1:] * values[:, :, :-1]).mean(),
        (values[:, 1:] * values[:, :-1]).mean(),
    ]
    # Standard deviations of correlations are 1/200 or less; 5.5 of them occur once in 10^7.
    assert np.abs(correlations).max() < 5.5 / 200 * values.var()


def test_the_probability_of_noisy_bits_is_exact():
    sensor = jl.Sensor(
        frames=2, gain=[0.5, 4.0], read_noise=0.3, dark_counts=0.1, mask=IMAGE > 0.95
    )
    own = sensor.probability(IMAGE)
    for frame, light in enumerate((0.5, 4.0)):
        expected = reading_probability(1, light * IMAGE + 0.1, read_noise=0.3)
        expected[IMAGE > 0.95] = 0
        np.testing.assert_allclose(own[frame], expected, rtol=1e-6)


def test_the_readings_of_the_jots_of_a_pixel_are_added():
    array = np.arange(48).reshape(2, 4, 6) % 16
    readings = jl.Readings(array, jl.Sensor(frames=2, bit_depth=4))
    fractions = []
    pixels = readings.sum(oversampling=2, progress=fractions.append)
    expected = array.sum(axis=0).reshape(2, 2, 3, 2).sum(axis=(1, 3))
    np.testing.assert_array_equal(pixels, expected)
    assert fractions[-1] == 1
    del fractions[:]
    with pytest.raises(ValueError, match=r"readings: expected .* multiples of the oversampling 3"):
        readings.sum(oversampling=3, progress=fractions.append)
    assert fractions == []
    with pytest.raises(TypeError, match=r"oversampling: expected a whole number, got 1\.5"):
        readings.sum(oversampling=1.5)


def test_readings_are_indexed_and_read_like_bits():
    array = np.arange(24).reshape(4, 2, 3) % 16
    readings = jl.Readings(array, jl.Sensor(frames=4, bit_depth=4))
    assert len(readings) == 4
    assert readings.shape == (4, 2, 3)
    np.testing.assert_array_equal(readings[-1], array[3])
    np.testing.assert_array_equal(list(readings), array)
    assert next(iter(readings)).dtype == np.uint16
    assert readings[1:3].sensor.frames == 2
    np.testing.assert_array_equal(readings[1:3].to_array(), array[1:3])
    np.testing.assert_array_equal(readings.sum(), array.sum(axis=0))
    for axis in (-3, (-3,), None, 1, (0, 1)):
        assert readings.sum(axis).dtype == np.int64
        np.testing.assert_array_equal(readings.sum(axis), array.sum(axis))
    assert "<th>" in readings._repr_html_()
    assert "4 bits" in repr(readings)
    for wrong in ((..., 3), [0, 2], 1.0):
        with pytest.raises(TypeError, match=r"readings: .* slice .* np\.asarray\(readings\)"):
            readings[wrong]
    with pytest.raises(IndexError, match="frame from 0 to 3"):
        readings[4]
    with pytest.raises(ValueError, match="no frames in 4:"):
        readings[4:]


SENSOR = jl.Sensor(frames=2, bit_depth=2)


@pytest.mark.parametrize(
    ("array", "sensor", "error", "message"),
    [
        (np.full((2, 3, 3), 4), SENSOR, ValueError, "expected 0 to 3 for 2 bits, got 4 to 4"),
        (np.full((2, 3, 3), -1), SENSOR, ValueError, "expected 0 to 3 for 2 bits"),
        (np.ones((2, 3, 3)), SENSOR, TypeError, r"got float64; numpy\.rint\(array\)\.astype"),
        (np.ones((2, 3, 3), bool), SENSOR, TypeError, "expected whole numbers, got bool$"),
        (np.ones(3, int), SENSOR, ValueError, r"expected shape \(T, H, W\)"),
        (
            np.ones((2, 3, 3, 9), int),
            SENSOR,
            ValueError,
            r"at most 4 .* \[Readings\(frames, ",
        ),
        (np.ones((3, 3, 3), int), SENSOR, ValueError, "expected the sensor's 2 frames, got 3"),
        (
            np.ones((2, 3, 3), int),
            jl.Sensor(frames=2),
            ValueError,
            r"\(frames=2, bit_depth=4\)",
        ),
        (np.ones((2, 3, 3), int), 4, TypeError, r"expected a jotlight\.Sensor"),
        (np.ma.ones((2, 3, 3), int), SENSOR, TypeError, "masked"),
    ],
)
def test_bad_readings_are_refused(array, sensor, error, message):
    with pytest.raises(error, match=message):
        jl.Readings(array, sensor)


def test_readings_of_another_depth_are_refused():
    readings = jl.Readings(np.ones((2, 3, 3), int), SENSOR)
    for depth in (1, 5):
        sensor = SENSOR.replace(bit_depth=depth)
        with pytest.raises(ValueError, match=r"sensor\.replace\(bit_depth=2\) is a sensor with re"):
            jl.mle(readings, sensor)


def test_bits_of_a_sensor_with_several_bits_are_refused():
    with pytest.raises(ValueError, match="expected readings of 2 bits, as the sensor states, got"):
        jl.Bits.from_array(np.ones((2, 3, 3), bool), SENSOR)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"bit_depth": 0}, "bit_depth: expected a whole number from 1 to 16"),
        ({"bit_depth": 17}, "bit_depth: expected a whole number from 1 to 16"),
        ({"bit_depth": 2.5}, "bit_depth: expected a whole number"),
        ({"read_noise": -0.1}, "read_noise: expected a number from 0 to 100"),
        ({"read_noise": math.nan}, "read_noise: expected a number from 0 to 100"),
        ({"read_noise": 1e-200}, "read_noise: expected 0, or 0.001 photons or more, got 1e-200"),
        ({"bit_depth": 2, "threshold": 2}, "readings of 2 bits state the number of photons"),
        ({"bit_depth": 2, "frames": 2, "threshold": [1, 2]}, "threshold: expected 1, because"),
    ],
)
def test_bad_parameters_are_refused(parameters, message):
    with pytest.raises(ValueError, match=message):
        jl.Sensor(**parameters)


def test_ambiguous_read_noise_is_stated():
    wrong = 1 - (stats.norm.cdf(0.5 / 0.6) - stats.norm.cdf(-0.5 / 0.6))
    with pytest.warns(jl.JotlightWarning, match=f"0.6 photons change {wrong:.0%} of the readings"):
        sensor = jl.Sensor(read_noise=0.6)
    assert sensor.replace(frames=2).read_noise == 0.6  # without another warning


def test_what_needs_single_bits_says_so():
    readings = several_bits().expose(IMAGE, rng=0)
    with pytest.raises(
        ValueError, match=r"got readings of 3 bits; pass the data to jotlight\.reconstruct"
    ):
        jl.admm_tv(readings)
    with pytest.raises(ValueError, match="reading_probability"):
        several_bits().probability(IMAGE)
    with pytest.raises(ValueError, match=r"out: expected none, .* has . bits and read noise"):
        several_bits().expose(IMAGE, out=np.zeros((5, 60, 5), np.uint8))
    with pytest.raises(ValueError, match="a sum of frames does not say which"):
        jl.mle(np.ones((30, 20), int), several_bits())


@pytest.mark.parametrize("method", [jl.reconstruct, jl.uncertainty, jl.mle, jl.noniterative])
def test_a_sensor_with_another_number_of_bits_is_refused(method):
    readings = jl.Sensor(frames=4, bit_depth=2).expose(np.full((8, 8), 0.5), rng=0)
    for bit_depth, expected in ((1, "single bits"), (3, "readings of 3 bits")):
        with pytest.raises(
            ValueError, match=f"{expected}, as the sensor states, got readings of 2"
        ):
            method(readings, jl.Sensor(frames=4, bit_depth=bit_depth))


def test_windows_are_readings_whose_sensor_has_as_many_frames():
    sensor = jl.Sensor(frames=10, gain=5.0, bit_depth=3)
    readings = sensor.expose(np.full((5, 9), 2.0), rng=0)
    parts = list(readings.windows(window=4, step=3))
    assert [part.sensor for part in parts] == [sensor.replace(frames=4, gain=2.0)] * 3
    for index, part in enumerate(parts):
        np.testing.assert_array_equal(part.to_array(), readings[3 * index : 3 * index + 4])
    with pytest.raises(ValueError, match=r"^window: expected 1 to the capture's 10 frames"):
        readings.windows(11)


def test_windows_of_a_bracket_keep_its_exposures():
    sensor = jl.Sensor(frames=6, gain=[1.0, 8.0] * 3, bit_depth=3)
    readings = sensor.expose(np.full((5, 9), 2.0), rng=0)
    assert [part.sensor.gain.tolist() for part in readings.windows(2)] == [[1.0, 8.0]] * 3
