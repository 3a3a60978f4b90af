"""The gray images of data, and their counts."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.layout import Layout
from jotlight.sensing.data.pixel_counts import GrayImages, gray_images, prepare_data

SENSOR = jl.Sensor(oversampling=2, frames=5)
IMAGES = np.random.default_rng(0).random((3, 6, 8))


def prepared(data, **options):
    return gray_images(prepare_data(data, SENSOR, **options)[0])


def test_a_hot_jot_among_others_makes_no_bias():
    dark = np.where(np.indices((64, 64)).sum(axis=0) % 8 == 0, 3.0, 0.01)
    sensor = jl.Sensor(oversampling=2, frames=64, gain=64.0, dark_counts=dark)
    bits = sensor.expose(np.full((32, 32), 0.5), rng=0)
    pixels = gray_images(prepare_data(bits, sensor)[0]).count(sensor, None)
    expected = -np.expm1(-0.25 * 0.5 - np.asarray(pixels.dark_counts))
    found = pixels.counts / pixels.trials
    hot = dark.reshape(32, 2, 32, 2).max(axis=(1, 3)) == 3.0
    for own in (hot, ~hot):
        np.testing.assert_allclose(found[0][own].mean(), expected[0][own].mean(), rtol=0.03)
    np.testing.assert_allclose(jl.noniterative(bits, threads=1)[hot].mean(), 0.5, rtol=0.1)


@pytest.mark.parametrize("axis", [None, 0, 1, -1])
def test_counts_become_gray_images_and_back(axis):
    counts = np.arange(120).reshape(2, 2, 5, 6) if axis is None else np.arange(80).reshape(2, 5, 8)
    images = prepared(counts, channel_axis=axis)
    assert all(image.ndim == 2 and image.flags.c_contiguous for image in images.data)
    doubled = images.layout.arrange(2 * images.data)
    np.testing.assert_array_equal(doubled, 2 * counts)
    assert doubled.flags.c_contiguous


@pytest.mark.parametrize("axis", [None, -1])
def test_bits_and_lists_of_bits_have_the_same_counts_as_arrays(axis):
    bits = SENSOR.expose(IMAGES, rng=0, channel_axis=None if axis is None else 0)
    images = prepared(bits)
    counts = images.layout.arrange(np.stack([each.counts() for each in images.data]))
    expected = bits.counts() if axis else np.stack([each.counts() for each in bits])
    np.testing.assert_array_equal(counts, expected)
    np.testing.assert_array_equal(images.layout.arrange(images.count(SENSOR, None).counts), counts)


def test_lists_of_color_bits_and_of_merged_counts():
    stack = [SENSOR.expose(IMAGES, rng=seed, channel_axis=0) for seed in (0, 1)]
    assert jl.mle(stack).shape == (2, 6, 8, 3)
    np.testing.assert_array_equal(jl.mle(stack)[1], jl.mle(stack[1]))
    merged = [
        jl.Merged(each.counts(), trials, SENSOR, channel_axis=-1)
        for each, trials in zip(stack, (20, 25), strict=True)
    ]
    np.testing.assert_array_equal(jl.mle(merged)[0], jl.mle(stack[0]))
    np.testing.assert_array_equal(jl.mle(merged)[1], jl.mle(merged[1]))
    assert not np.array_equal(jl.mle(merged)[1], jl.mle(stack[1]))


def test_maps_of_the_sensor_and_of_trials_hold_for_each_image():
    jots = 2 * IMAGES.shape[1], 2 * IMAGES.shape[2]
    rng = np.random.default_rng(1)
    dark = np.repeat(np.repeat(rng.random(IMAGES.shape[1:]) / 9, 2, 0), 2, 1)
    sensor = SENSOR.replace(dark_counts=dark, mask=rng.random(jots) < 0.1)
    bits = sensor.expose(IMAGES, rng=2)
    for method in (jl.mle, jl.pretrained(sensor).reconstruct):
        together = method(bits)
        for index in range(3):
            np.testing.assert_allclose(together[index], method(bits[index]), rtol=1e-6, atol=1e-6)
    counts = np.stack([each.counts() for each in bits])
    trials = counts + rng.random(counts.shape)
    together = jl.mle(counts, SENSOR, trials=trials)
    np.testing.assert_array_equal(together[2], jl.mle(counts[2], SENSOR, trials=trials[2]))


@pytest.mark.parametrize(("max_pixels", "sizes"), [(1, [1, 1, 1]), (96, [2, 1]), (999, [3])])
def test_the_parts_of_a_stack_have_a_maximum_number_of_pixels(max_pixels, sizes):
    bits = SENSOR.expose(IMAGES, rng=0)
    for data in (bits, np.stack([each.counts() for each in bits])):
        parts = list(prepared(data).parts(SENSOR, max_pixels))
        assert [len(part) for part in parts] == sizes
        counts = np.concatenate([part.count(SENSOR, None).counts for part in parts])
        np.testing.assert_array_equal(counts, np.stack([each.counts() for each in bits]))


def test_the_bits_of_a_stack_are_independent_and_begin_with_those_of_the_first_image():
    half = np.full((3, 200, 200), np.log(2))
    bits = jl.Sensor(gain=1).expose(half, rng=4)
    np.testing.assert_array_equal(bits[0], jl.Sensor(gain=1).expose(half[0], rng=4))
    frames = [each[0].astype(float) for each in bits]
    for one, other in ((0, 1), (1, 2), (0, 2)):
        assert abs(np.mean(frames[one] == frames[other]) - 0.5) < 5 * 0.5 / 200
    out = np.empty((3, 1, 200, 25), np.uint8)
    jl.Sensor(gain=1).expose(half, rng=4, out=out)
    np.testing.assert_array_equal(out[2], bits[2].packed)


@pytest.mark.parametrize(
    ("data", "options", "error", "message"),
    [
        ([SENSOR.expose(IMAGES[0], 0)], {"channel_axis": 0}, TypeError, "list state their own"),
        (SENSOR.expose(IMAGES[0], 0), {"channel_axis": 0}, TypeError, "Bits state their own"),
        (
            [SENSOR.expose(IMAGES[0], 0), np.ones((6, 8), int)],
            {},
            (TypeError, ValueError),
            "data|inhomogeneous",
        ),
        (np.ones((2, 6, 8), int), {"trials": np.ones((2, 6, 7))}, ValueError, "trials: expected"),
    ],
)
def test_data_that_do_not_fit_are_refused(data, options, error, message):
    with pytest.raises(error, match=message):
        prepare_data(data, SENSOR, **options)


@pytest.mark.parametrize("data", [None, jl.Sensor(), {}])
@pytest.mark.parametrize("sensor", [None, jl.Sensor()])
def test_the_type_of_the_data_is_checked_before_the_sensor(data, sensor):
    with pytest.raises(TypeError, match=f"^data: expected .* counts .*, got {type(data).__name__}"):
        jl.reconstruct(data, sensor)


def test_lists_of_bits_without_a_sensor_are_called_bits():
    bits = jl.Bits.from_array(np.ones((2, 4, 5), bool))
    with pytest.raises(TypeError, match=r"^sensor: .* because these bits carry none"):
        jl.mle([bits, bits])


def test_images_of_different_sizes_and_sensors_are_refused():
    small, large = (SENSOR.expose(np.full((side, side), 0.5), rng=0) for side in (4, 6))
    with pytest.raises(ValueError, match="images of the same size"):
        jl.mle([small, large])
    with pytest.raises(ValueError, match="bits of the same sensor"):
        jl.mle([small, jl.Sensor(frames=3).expose(np.full((4, 4), 0.5), rng=0)])


def test_parts_of_a_stack_keep_images_together():
    images = GrayImages(np.zeros((12, 4, 4), np.int32), Layout((4, 3), -1))
    sizes = [len(part) for part in images.parts(jl.Sensor(), 7 * 16, together=3)]
    assert sizes == [6, 6]
    assert [len(part) for part in images.parts(jl.Sensor(), 16, together=3)] == [3, 3, 3, 3]
