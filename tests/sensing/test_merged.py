"""Counts whose pixels may have different numbers of trials."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.data.pixel_counts import count_pixels, gray_images, prepare_data

SENSOR = jl.Sensor(frames=8, dark_counts=0.01, efficiency=0.5)
ONES = np.array([[3, 0, 1], [8, 2, 0]])
TRIALS = np.array([[4.5, 0.0, 1.0], [8.0, 2.25, 7.0]])


def test_a_number_of_trials_and_the_sensor_s_values_are_the_defaults():
    merged = jl.Merged(ONES, 8, SENSOR)
    assert merged.trials == 8
    assert (merged.dark_counts, merged.efficiency) == (0.01, 0.5)
    assert merged.acceptance is merged.posterior_error is merged.flags is None
    assert merged.shape == (2, 3)
    assert repr(merged).startswith("<Merged: 2 x 3, 8 trials, Sensor(frames=8")


def test_maps_are_kept():
    maps = {
        "dark_counts": 0.1 * np.arange(6.0).reshape(2, 3),
        "efficiency": 0.1 + 0.1 * np.arange(6.0).reshape(2, 3),
        "acceptance": np.full((2, 3), 0.9),
        "posterior_error": np.full((2, 3), np.inf),
        "flags": np.eye(2, 3, dtype=bool),
    }
    merged = jl.Merged(ONES, TRIALS, SENSOR, **maps)
    for name, expected in maps.items():
        np.testing.assert_allclose(getattr(merged, name), expected, rtol=1e-6)
    pixels = count_pixels(merged, SENSOR, None)
    np.testing.assert_array_equal(pixels.counts, ONES)
    np.testing.assert_array_equal(pixels.trials, TRIALS)
    np.testing.assert_array_equal(pixels.dark_counts, maps["dark_counts"])
    np.testing.assert_array_equal(pixels.efficiency, maps["efficiency"])
    np.testing.assert_array_equal(pixels.dead_pixels, TRIALS == 0)
    assert not pixels.uniform


def test_maps_of_the_sensor_become_those_of_the_pixels():
    dark = np.repeat(np.repeat(np.float32([[0.1, 0.2, 0.4]]), 2, 0), 2, 1)
    sensor = jl.Sensor(oversampling=2, dark_counts=np.vstack([dark, dark]))
    merged = jl.Merged(np.minimum(ONES, 4), 4, sensor)
    np.testing.assert_allclose(merged.dark_counts, [[0.1, 0.2, 0.4]] * 2, rtol=1e-6)
    with pytest.raises(ValueError, match=r"dark_counts: .*shape \(4, 8\)"):
        jl.Merged(np.ones((2, 4), int), 4, sensor)
    uneven = sensor.replace(dark_counts=np.arange(24.0).reshape(4, 6))
    with pytest.raises(ValueError, match="dark_counts: expected the mean of each pixel"):
        jl.Merged(np.minimum(ONES, 4), 4, uneven)


def test_channels_have_their_own_trials():
    ones, trials = np.stack([ONES, ONES // 2], -1), np.stack([TRIALS, TRIALS + 1], -1)
    channels = list(jl.Merged(ones, trials, SENSOR, channel_axis=-1).channels())
    moved = np.moveaxis(ones, -1, 0), np.moveaxis(trials, -1, 0)
    first = jl.Merged(*moved, SENSOR, channel_axis=0)
    assert (first.shape, first.channel_axis) == (ones.shape, -1)
    np.testing.assert_array_equal(first.trials, trials)
    for index, channel in enumerate(channels):
        np.testing.assert_array_equal(channel.ones, ones[..., index])
        np.testing.assert_array_equal(channel.trials, trials[..., index])
    assert [
        channel.trials for channel in jl.Merged(ones, 9, SENSOR, channel_axis=-1).channels()
    ] == [9, 9]


def test_a_constant_map_is_as_uniform_as_a_number():
    assert count_pixels(jl.Merged(ONES, np.full((2, 3), 8), SENSOR), SENSOR, None).uniform


@pytest.mark.parametrize(
    ("arguments", "options", "error", "message"),
    [
        ((ONES * 0.5, 8, SENSOR), {}, TypeError, "image of counts in whole numbers"),
        ((ONES, 8, "sensor"), {}, TypeError, "sensor: expected a jotlight.Sensor, got str"),
        ((ONES, 7.9, SENSOR), {}, ValueError, "ones: .*got 8 of 7.9 at the index"),
        ((ONES, TRIALS - 1, SENSOR), {}, ValueError, "trials: expected finite numbers, 0 or more"),
        ((ONES, np.nan, SENSOR), {}, ValueError, "trials: expected finite numbers, 0 or more"),
        ((ONES, TRIALS[:1], SENSOR), {}, ValueError, r"trials: .*shape \(2, 3\), got \(1, 3\)"),
        ((ONES, 8, SENSOR, 0.1), {}, TypeError, "positional arguments"),
        ((ONES, 8, SENSOR), {"dark_counts": -1}, ValueError, "dark_counts: expected finite"),
        ((ONES, 8, SENSOR), {"dark_counts": [0.1]}, ValueError, r"one value per pixel, .*\(1,\)"),
        ((ONES, 8, SENSOR), {"efficiency": 0}, ValueError, "efficiency: .*got 0.0 to 0.0"),
        ((ONES, 8, SENSOR), {"efficiency": 1.1}, ValueError, "efficiency: expected numbers above"),
        ((ONES, 8, SENSOR), {"acceptance": TRIALS}, ValueError, "acceptance: .* from 0 to 1"),
        ((ONES, 8, SENSOR), {"acceptance": [1.0]}, ValueError, "acceptance: expected one value"),
        (
            (ONES, 8, SENSOR),
            {"posterior_error": -TRIALS},
            ValueError,
            "posterior_error: .*0 to inf",
        ),
        ((ONES, 8, SENSOR), {"flags": TRIALS}, TypeError, "flags: expected an array of bool"),
        ((ONES, 8, SENSOR), {"flags": [True]}, ValueError, "flags: expected one value per pixel"),
        ((ONES, 8, SENSOR), {"light_share": 0}, ValueError, "light_share: expected a finite num"),
        ((ONES, 8, SENSOR), {"valid_up_to": 0}, ValueError, "valid_up_to: expected a finite num"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(arguments, options, error, message):
    with pytest.raises(error, match=message):
        jl.Merged(*arguments, **options)


def test_the_sensor_is_the_given_one_or_that_of_the_data():
    bits = SENSOR.expose(np.full((2, 3), 0.5), rng=0)
    merged, other = jl.Merged(ONES, 8, SENSOR), SENSOR.replace(max_intensity=2.0)
    for data in (bits, merged):
        assert prepare_data(data, None)[1] == SENSOR
        assert prepare_data(data, other)[1] == other
    with pytest.raises(TypeError, match=r"because counts carry none; .*Sensor\(frames=16\)"):
        prepare_data(ONES, None)
    with pytest.raises(TypeError, match="because these bits carry none"):
        prepare_data(jl.Bits(bits.packed, bits.width), None)
    with pytest.raises(TypeError, match=r"sensor: expected a jotlight.Sensor, such as"):
        prepare_data(ONES, 8)


@pytest.mark.parametrize(
    "run",
    [
        jl.reconstruct,
        jl.uncertainty,
        jl.mle,
        jl.admm_tv,
        lambda data, sensor: jl.pretrained(sensor, "two-layer").reconstruct(data, sensor),
    ],
)
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"mask": np.eye(2, 3, dtype=bool)},
            "mask: expected that of .*; leave out the sensor, or pass it where",
        ),
        ({"dark_counts": 0.02}, "dark_counts: expected that of the sensor of the merged counts"),
        ({"efficiency": 0.25}, "efficiency: expected that of the sensor of the merged counts"),
        ({"max_intensity": 4.5}, "max_intensity: expected at most 4, .* merge the readings again"),
    ],
)
def test_a_sensor_that_contradicts_the_counts_is_refused(run, changes, message):
    merged = jl.Merged(ONES, 8, SENSOR, valid_up_to=4.0)
    with pytest.raises(ValueError, match=message):
        run(merged, SENSOR.replace(**changes))


def test_other_sensors_are_accepted():
    merged = jl.Merged(ONES, 8, SENSOR.replace(mask=np.eye(2, 3, dtype=bool)), valid_up_to=4.0)
    for data in (merged, [merged, merged]):
        assert prepare_data(data, SENSOR.replace(max_intensity=4.0))[1].mask is None
    with pytest.raises(ValueError, match="mask: expected that of"):
        prepare_data([merged, merged], SENSOR.replace(mask=np.zeros((2, 3), bool)))
    dark_counts = np.linspace(0.01, 0.1, 6).reshape(2, 3)
    merged = jl.Merged(ONES, 8, SENSOR.replace(dark_counts=dark_counts))
    for others in (0.0, np.float32(dark_counts)):
        prepare_data(merged, SENSOR.replace(dark_counts=others))


def test_trials_turn_counts_into_merged_counts():
    data, _ = prepare_data(ONES, SENSOR, TRIALS)
    np.testing.assert_array_equal(data.trials, TRIALS)
    np.testing.assert_array_equal(data.ones, ONES)
    with pytest.raises(TypeError, match="trials: expected none, because Merged state their own"):
        prepare_data(data, None, 8)
    bits = SENSOR.expose(np.full((2, 3), 0.5), rng=0)
    with pytest.raises(TypeError, match="trials: expected none, because Bits state their own"):
        prepare_data(bits, None, 8)


@pytest.mark.parametrize("channel_axis", [None, 0, -1])
def test_masked_pixels_have_no_trials(channel_axis):
    mask = np.array([[True, False, False], [False, False, True]])
    counts = np.ones((2, 3), int)
    if channel_axis is not None:
        counts = np.stack([counts] * 2, axis=channel_axis)
    data, _ = prepare_data(counts, SENSOR.replace(mask=mask), 4, channel_axis)
    for each in gray_images(data).data:
        np.testing.assert_array_equal(each.trials, 4.0 * ~mask)
        np.testing.assert_array_equal(each.ones, 1 * ~mask)
    single_jots = jl.Sensor(oversampling=2, mask=np.zeros((4, 6), bool))
    with pytest.raises(ValueError, match="with a mask of single jots the bits are needed"):
        prepare_data(counts, single_jots, 4, channel_axis)
    with pytest.raises(ValueError, match="mask: expected one value per jot"):
        prepare_data(counts, SENSOR.replace(mask=mask[:1]), 4, channel_axis)


def test_merged_counts_are_no_single_array():
    merged = jl.Merged(np.ones((2, 3), int), 4.0, jl.Sensor(frames=4))
    for convert in (np.asarray, np.array, lambda data: np.asarray(data, np.float32)):
        with pytest.raises(TypeError, match=r"got Merged; merged\.ones and merged\.trials are its"):
            convert(merged)


@pytest.mark.parametrize(
    ("trials", "text"), [(1, "1 trial"), (3.0, "3 trials"), ([[1, 2.5]], "1 to 2.5 trials")]
)
def test_the_text_names_the_trials(trials, text):
    assert f", {text}, " in repr(jl.Merged([[1, 1]], trials, jl.Sensor()))
