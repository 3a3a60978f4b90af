import numpy as np
import pytest

import jotlight as jl
from reference import methods

SENSORS = [
    {},
    {"threshold": 2},
    {"threshold": 5, "max_intensity": 30.0},
    {"dark_counts": 0.3},
    {"efficiency": 0.4, "max_intensity": 5.0},
    {"threshold": 2, "efficiency": 0.7, "dark_counts": 0.1, "max_intensity": 4.0},
    {"gain": 200.0, "max_intensity": 0.2},
]


def sensitivity(sensor):
    return sensor.efficiency * sensor.gain / sensor.trials


def reference_mle(counts, trials, sensor, dark):
    return methods.mle(
        counts,
        trials,
        threshold=sensor.threshold,
        sensitivity=sensitivity(sensor),
        dark=dark,
        max_intensity=sensor.max_intensity,
    )


@pytest.mark.parametrize("options", SENSORS, ids=str)
@pytest.mark.parametrize("frames", [1, 7, 64])
def test_the_estimate_of_every_count_is_the_closed_form(options, frames):
    sensor = jl.Sensor(frames=frames, **options)
    counts = np.arange(frames + 1)[None]
    expected = reference_mle(counts, frames, sensor, sensor.dark_counts)
    np.testing.assert_allclose(jl.mle(counts, sensor), expected, rtol=2e-7, atol=1e-9)


@pytest.mark.parametrize("options", SENSORS, ids=str)
def test_the_size_of_the_image_does_not_change_the_estimate_of_a_count(options):
    sensor = jl.Sensor(frames=40, **options)
    large = np.arange(41).repeat(5)[None]
    small = np.concatenate([jl.mle(part, sensor) for part in np.split(large, 41, axis=1)], axis=1)
    np.testing.assert_array_equal(jl.mle(large, sensor), small)


@pytest.mark.parametrize("threshold", [1, 3])
def test_each_pixel_is_estimated_with_its_own_dark_counts(threshold):
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0, 0.5, (5, 6)).astype(np.float32)
    sensor = jl.Sensor(
        oversampling=2, frames=3, threshold=threshold, dark_counts=pixels.repeat(2, 0).repeat(2, 1)
    )
    counts = rng.integers(0, 13, (5, 6))
    expected = reference_mle(counts, 12, sensor, pixels)
    np.testing.assert_allclose(jl.mle(counts, sensor), expected, rtol=2e-7, atol=1e-9)


@pytest.mark.parametrize("dark_counts", [0.0, 0.2])
@pytest.mark.parametrize("threshold", [1, 2])
def test_dead_jots_are_excluded_from_ones_and_trials(threshold, dark_counts):
    rng = np.random.default_rng(1)
    mask = rng.random((12, 15)) < 0.4
    mask[::3, ::3] = False
    bits = rng.random((4, 12, 15)) < 0.4
    sensor = jl.Sensor(
        oversampling=3, frames=4, threshold=threshold, dark_counts=dark_counts, mask=mask
    )
    blocks = (4, 3, 5, 3)
    counts = (bits & ~mask).sum(0).reshape(blocks).sum((1, 3))
    trials = 4 * (~mask).reshape(blocks).sum((1, 3))
    expected = reference_mle(counts, trials, sensor, dark_counts)
    estimate = jl.mle(jl.Bits.from_array(bits), sensor)
    np.testing.assert_allclose(estimate, expected, rtol=2e-7, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "masked"),
    [
        (SENSORS[0], False),
        *((options, True) for options in (*SENSORS[:3], SENSORS[5])),
        *(
            pytest.param(options, False, marks=pytest.mark.slow)
            for options in (*SENSORS[1:3], SENSORS[5])
        ),
    ],
    ids=str,
)
def test_with_dark_counts_per_jot_the_estimate_maximizes_the_likelihood(options, masked):
    rng = np.random.default_rng(2)
    dark = rng.uniform(0, 0.6, (8, 12)).astype(np.float32)
    dark[:2] = 0
    mask = rng.random((8, 12)) < 0.3
    mask[::2, ::2] = False
    sensor = jl.Sensor(
        oversampling=2,
        frames=5,
        **options | {"dark_counts": dark, "mask": mask if masked else None},
    )
    bits = rng.random((5, 8, 12)) < rng.uniform(0, 1, (8, 12))
    bits[:, 2:4], bits[:, 4:6] = False, True
    estimate = jl.mle(jl.Bits.from_array(bits), sensor)
    live = ~mask if masked else np.ones_like(mask)
    for row, column in np.ndindex(estimate.shape):
        block = np.s_[2 * row : 2 * row + 2, 2 * column : 2 * column + 2]
        expected = methods.maximum_likelihood_intensity(
            bits.sum(0)[block][live[block]],
            5,
            dark[block][live[block]],
            threshold=sensor.threshold,
            sensitivity=sensitivity(sensor),
            max_intensity=sensor.max_intensity,
        )
        assert estimate[row, column] == pytest.approx(
            expected, abs=1e-6 * sensor.max_intensity, rel=1e-6
        )


@pytest.mark.parametrize(
    "dark_counts", [0.1, np.full((8, 8), 0.1), np.eye(4).repeat(2, 0).repeat(2, 1)]
)
def test_bits_and_their_counts_give_the_same_estimate(dark_counts):
    bits = jl.Bits.from_array(np.random.default_rng(3).random((6, 8, 8)) < 0.5)
    sensor = jl.Sensor(oversampling=2, frames=6, dark_counts=dark_counts)
    np.testing.assert_array_equal(jl.mle(bits, sensor), jl.mle(bits.counts(2), sensor))


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint64, np.int64, list])
def test_counts_of_any_integer_type_are_accepted(dtype):
    counts = [[0, 3], [7, 8]]
    data = counts if dtype is list else np.array(counts, dtype)
    expected = methods.mle(counts, 8)
    np.testing.assert_allclose(jl.mle(data, jl.Sensor(frames=8)), expected, rtol=1e-6)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_color_channels_are_estimated_independently(channels):
    bits = np.random.default_rng(4).random((3, 4, 6, channels)) < 0.5
    sensor = jl.Sensor(oversampling=2, frames=3, mask=np.eye(4, 6, dtype=bool))
    estimate = jl.mle(jl.Bits.from_array(bits), sensor)
    assert estimate.shape == (2, 3, channels)
    for channel in range(channels):
        alone = jl.mle(jl.Bits.from_array(bits[..., channel]), sensor)
        np.testing.assert_array_equal(estimate[..., channel], alone)


def test_channels_of_color_counts_are_estimated_independently():
    counts = np.random.default_rng(5).integers(0, 10, (4, 5, 3))
    expected = methods.mle(counts, 9)
    np.testing.assert_allclose(jl.mle(counts, jl.Sensor(frames=9)), expected, rtol=1e-6)


@pytest.mark.parametrize("dark_counts", [0.0, np.linspace(0, 1, 60).reshape(6, 10)])
def test_a_pixel_without_live_jots_is_filled_from_its_neighbors(dark_counts):
    bits = jl.Bits.from_array(np.random.default_rng(6).random((9, 6, 10)) < 0.3)
    mask = np.zeros((6, 10), bool)
    mask[2:4, 4:6] = True
    sensor = jl.Sensor(oversampling=2, frames=9, dark_counts=dark_counts, mask=mask)
    with pytest.warns(jl.JotlightWarning, match="1 of 15 pixels"):
        estimate = jl.mle(bits, sensor)
    plain = jl.mle(bits, sensor.replace(mask=None))
    neighbors = np.delete(plain[0:3, 1:4].ravel(), 4)
    assert estimate[1, 2] == pytest.approx(neighbors.mean(), rel=1e-6)
    assert np.array_equal(np.delete(estimate, 7), np.delete(plain, 7))


def test_counts_of_dead_pixels_are_ignored():
    mask = np.zeros((3, 3), bool)
    mask[1, 1] = True
    counts = np.full((3, 3), 2)
    counts[1, 1] = 999
    with pytest.warns(jl.JotlightWarning):
        estimate = jl.mle(counts, jl.Sensor(frames=4, mask=mask))
    np.testing.assert_allclose(estimate, np.log(2), rtol=1e-6)


SENSOR_2X2 = jl.Sensor(oversampling=2)
UNEQUAL = jl.Sensor(oversampling=2, dark_counts=np.linspace(0, 1, 16).reshape(4, 4))


@pytest.mark.parametrize(
    ("data", "sensor", "error", "message"),
    [
        ([[5]], SENSOR_2X2, ValueError, "expected 0 to K = 4"),
        ([[-1]], SENSOR_2X2, ValueError, "got -1"),
        ([[-(2**32)]], SENSOR_2X2, ValueError, "got -4294967296"),
        ([[2**32]], SENSOR_2X2, ValueError, "got .*4294967296"),
        ([[1.0]], SENSOR_2X2, TypeError, "float64"),
        ([[True]], SENSOR_2X2, TypeError, "bool"),
        ([["1"]], SENSOR_2X2, TypeError, "data: expected jotlight.Bits or an image of counts"),
        ([1, 2], SENSOR_2X2, ValueError, r"expected shape \(H, W\)"),
        (3, SENSOR_2X2, ValueError, r"expected shape \(H, W\)"),
        (np.zeros((2, 0), int), SENSOR_2X2, ValueError, r"expected shape \(H, W\)"),
        (np.zeros((5, 6, 4), int), SENSOR_2X2, ValueError, "looks like color"),
        (np.zeros((1, 5, 6, 3), int), SENSOR_2X2, ValueError, "looks like color"),
        ([[1]], jl.Sensor(mask=np.zeros((2, 2), bool)), ValueError, "mask: expected one value"),
        ([[1]], jl.Sensor(dark_counts=np.zeros((2, 2))), ValueError, "dark_counts: expected one"),
        ([[1]], SENSOR_2X2.replace(mask=np.zeros((2, 2), bool)), ValueError, "the bits are needed"),
        (np.ones((2, 2), int), UNEQUAL, ValueError, "expected bits, because"),
        (
            jl.Bits.from_array(np.ones((2, 4, 4), bool)),
            SENSOR_2X2,
            ValueError,
            "expected the sensor's 1",
        ),
        (jl.Bits.from_array(np.ones((1, 4, 5), bool)), SENSOR_2X2, ValueError, "multiples"),
        (jl.Bits.from_array(np.ones((1, 2, 4), bool)), UNEQUAL, ValueError, "dark_counts"),
    ],
)
def test_data_that_do_not_fit_the_sensor_are_refused(data, sensor, error, message):
    with pytest.raises(error, match=message):
        jl.mle(data, sensor)


def test_a_sensor_without_live_jots_is_refused():
    with pytest.raises(ValueError, match="at least one pixel with a valid bit"):
        jl.mle([[1]], jl.Sensor(mask=np.ones((1, 1), bool)))
