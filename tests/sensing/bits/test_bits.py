"""Packed bits: packing, counting, slicing, and checks."""

import re
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.parameters.provenance import Provenance
from reference.sensing import block_counts

RANDOM = np.random.default_rng(0)


def random_bits(*shape):
    return RANDOM.random(shape) < 0.4


@pytest.mark.parametrize("width", [1, 7, 8, 9, 64, 65, 123])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_the_first_jot_is_the_most_significant_bit_of_the_first_byte(width, channels):
    array = random_bits(3, 5, width, *channels)
    bits = jl.Bits.from_array(array)
    assert bits.packed.shape == (3, 5, -(-width // 8), *channels)
    for column in range(width):
        byte = bits.packed[:, :, column // 8]
        np.testing.assert_array_equal(byte >> (7 - column % 8) & 1, array[:, :, column])
    padding = bits.packed[:, :, -1] & (0xFF >> (width - 1) % 8 + 1)
    assert not padding.any()
    np.testing.assert_array_equal(bits.to_array(), array)
    assert bits.to_array().dtype == bool
    assert bits.shape == array.shape
    assert len(bits) == 3


@pytest.mark.parametrize("dtype", [np.uint8, np.int64, np.uint16])
@pytest.mark.parametrize("channels", [(), (1,)])
def test_zeros_and_ones_of_any_type_are_bits(dtype, channels):
    array = random_bits(3, 5, 9, *channels)
    np.testing.assert_array_equal(jl.Bits.from_array(array.astype(dtype)).to_array(), array)


def test_a_single_frame_needs_no_axis_of_frames():
    array = random_bits(5, 9)
    np.testing.assert_array_equal(jl.Bits.from_array(array).to_array(), array[None])


def test_the_channels_of_color_bits_are_bits_with_the_same_sensor():
    sensor = jl.Sensor(frames=3)
    array = random_bits(3, 5, 9, 2)
    channels = jl.Bits.from_array(array, sensor).channels()
    assert [channel.sensor for channel in channels] == [sensor, sensor]
    for index, channel in enumerate(channels):
        np.testing.assert_array_equal(channel.to_array(), array[..., index])


def test_parts_of_bits_keep_their_origin_and_need_no_other_test():
    origin = Provenance("npy", "a.npy")
    bits = jl.Bits.from_array(random_bits(3, 5, 9, 2)).replace(
        provenance=origin, tested_for_periods=True
    )
    for part in (*bits.channels(), bits[:2], bits.replace(sensor=jl.Sensor(frames=3))):
        assert part.tested_for_periods
        assert part.provenance.name == "a.npy"
    with pytest.raises(TypeError, match="unexpected keyword argument 'frames'"):
        bits.replace(frames=2)


def test_gray_bits_are_their_own_only_channel():
    bits = jl.Bits.from_array(random_bits(3, 5, 9))
    assert bits.channels() == [bits]


def test_one_frame_is_an_array():
    array = random_bits(3, 5, 9, 2)
    bits = jl.Bits.from_array(array)
    for index in (0, 2, -1, -3, np.int64(1)):
        np.testing.assert_array_equal(bits[index], array[index])
    assert bits[0].dtype == bool
    for wrong in (3, -4):
        with pytest.raises(IndexError, match=f"expected a frame from 0 to 2, got {wrong}"):
            bits[wrong]
    for wrong in (1.0, "a", None, ..., [0], (), True, np.array([0])):
        with pytest.raises(TypeError, match=r"the number of a frame, .* np\.asarray\(bits\)"):
            bits[wrong]


def test_iteration_and_conversion_yield_all_frames():
    array = random_bits(3, 5, 9)
    bits = jl.Bits.from_array(array)
    np.testing.assert_array_equal(np.stack(list(bits)), array)
    np.testing.assert_array_equal(np.asarray(bits), array)
    np.testing.assert_array_equal(np.asarray(bits, np.float32), array.astype(np.float32))
    assert np.asarray(bits).dtype == bool
    assert np.mean(bits) == array.mean()
    with pytest.raises(ValueError, match="copy=False"):
        bits.__array__(copy=False)


def test_frames_of_files_are_read_part_by_part(tmp_path):
    array = random_bits(64, 40, 61)
    jl.save(jl.Bits.from_array(array), tmp_path / "bits.npy")
    bits = jl.open(tmp_path / "bits.npy")
    np.testing.assert_array_equal(bits[63], array[63])
    for found, expected in zip(bits, array, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_windows_are_bits_whose_sensor_has_as_many_frames():
    bits = jl.Bits.from_array(random_bits(10, 5, 9), jl.Sensor(frames=10, gain=5.0))
    parts = list(bits.windows(window=4, step=3))
    assert [part.sensor for part in parts] == [jl.Sensor(frames=4, gain=2.0)] * 3
    for index, part in enumerate(parts):
        np.testing.assert_array_equal(part.to_array(), bits[3 * index : 3 * index + 4].to_array())
    with pytest.raises(ValueError, match=r"^window: expected 1 to the capture's 10 frames"):
        bits.windows(11)


class OtherSensor:
    """An object with the interface that bits require of a sensor."""

    oversampling, frames, trials, kernel, bit_depth = 3, 2, 18, "box", 1

    def replace(self, **changes):
        other = OtherSensor()
        vars(other).update(changes)
        return other

    def select_frames(self, frames):
        return self.replace(frames=len(range(self.frames)[frames]))

    def check_map_shapes(self, height, width):
        assert (height, width) == (6, 9)

    def maps(self):
        return {}

    def scalars(self):
        return {"frames": self.frames}


def test_bits_take_any_object_with_the_interface_of_a_sensor():
    array = random_bits(2, 6, 9)
    bits = jl.Bits.from_array(array, OtherSensor())
    np.testing.assert_array_equal(bits.counts(), block_counts(array, 3))
    assert bits[:1].sensor.frames == 1
    with pytest.raises(TypeError, match=r"expected jotlight\.Sensor, got OtherSensor"):
        carried_sensor(bits)


@pytest.mark.parametrize(
    "part", [slice(2), slice(1, 4), slice(None, None, 2), slice(None, None, -1), slice(-1, None)]
)
def test_a_slice_has_its_frames_and_a_sensor_of_that_number_of_frames(part):
    array = random_bits(5, 4, 9)
    sensor = jl.Sensor(frames=5, gain=20)
    bits = jl.Bits.from_array(array, sensor)[part]
    np.testing.assert_array_equal(bits.to_array(), array[part])
    frames = len(array[part])
    assert bits.sensor == jl.Sensor(frames=frames, gain=4 * frames)
    assert np.shares_memory(bits.packed, bits[:1].packed)
    assert jl.Bits.from_array(array)[part].sensor is None


def test_a_slice_without_frames_is_refused():
    with pytest.raises(ValueError, match="no frames in 5: of 5"):
        jl.Bits.from_array(random_bits(5, 4, 9))[5:]


@pytest.mark.parametrize(
    ("array", "error", "message"),
    [
        (np.zeros((2, 2, 2)), TypeError, "0 and 1, got float64"),
        (np.zeros((2, 2, 2), object), TypeError, "0 and 1, got object"),
        (np.zeros((2, 2, 2), complex), TypeError, "0 and 1, got complex128"),
        ("1010", TypeError, "0 and 1, got <U4"),
        (np.full((2, 2, 2), 2), ValueError, "0 and 1 only, got 2 to 2"),
        (np.full((2, 2, 2), 255), ValueError, "got 255 to 255; methods take an image of counts"),
        (np.eye(3, dtype=np.uint8) * 255, ValueError, "to 255; pass array == 255 for black and"),
        (np.full((2, 2, 2), -1), ValueError, "0 and 1 only, got -1 to -1"),
        (np.array([[[0, 1, 255]]], np.uint8), ValueError, "got 0 to 255"),
        (np.zeros(8, bool), ValueError, r"expected shape \(T, H, W\)"),
        (np.zeros((1, 2, 3, 4, 5), bool), ValueError, r"expected shape \(T, H, W\)"),
        (np.zeros((0, 2, 2), bool), ValueError, "without a dimension of 0"),
        (np.zeros((2, 2, 0), bool), ValueError, "without a dimension of 0"),
    ],
)
def test_arrays_that_are_not_bits_are_refused(array, error, message):
    with pytest.raises(error, match=message):
        jl.Bits.from_array(array)


@pytest.mark.parametrize(
    ("packed", "width", "error", "message"),
    [
        (np.zeros((2, 2, 2)), None, TypeError, "uint8 .*got float64"),
        (np.zeros((2, 2, 2), bool), None, TypeError, "got bool; Bits.from_array"),
        ([[[1]]], None, TypeError, "got list"),
        (np.zeros((2, 2), np.uint8), None, ValueError, r"packed: expected shape \(T, H"),
        (np.zeros((0, 2, 2), np.uint8), None, ValueError, "without a dimension of 0"),
        (np.zeros((2, 2, 2), np.uint8), 8, ValueError, "9 to 16 for 2 bytes a row, got 8"),
        (np.zeros((2, 2, 2), np.uint8), 17, ValueError, "9 to 16 for 2 bytes a row, got 17"),
        (np.zeros((2, 2, 2), np.uint8), 0, ValueError, "got 0"),
        (np.zeros((2, 2, 2), np.uint8), -9, ValueError, "got -9"),
    ],
)
def test_bytes_or_a_width_that_do_not_fit_are_refused(packed, width, error, message):
    with pytest.raises(error, match=message):
        jl.Bits(packed, width)


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (jl.Sensor(frames=2), "expected the sensor's 2 frames, got 3"),
        (jl.Sensor(frames=3, oversampling=5), "multiples of the oversampling 5, got 4 x 6"),
        (jl.Sensor(frames=3, mask=np.zeros((6, 4), bool)), "mask: .*got shape"),
        (jl.Sensor(frames=3, dark_counts=np.zeros((4, 7))), "dark_counts: .*got shape"),
    ],
)
def test_a_sensor_that_did_not_make_these_bits_is_refused(sensor, message):
    with pytest.raises(ValueError, match=message):
        jl.Bits.from_array(random_bits(3, 4, 6), sensor)


@pytest.mark.parametrize(
    ("shape", "text"),
    [
        ((1, 4, 9), "<Bits: 1 frame of 4 x 9 jots>"),
        ((2, 4, 9), "<Bits: 2 frames of 4 x 9 jots>"),
        ((2, 4, 9, 3), "<Bits: 2 frames of 4 x 9 jots x 3 channels>"),
    ],
)
def test_repr_shows_the_true_shape(shape, text):
    assert repr(jl.Bits.from_array(random_bits(*shape))) == text


HWT = np.moveaxis(np.random.default_rng(3).random((8, 128, 100)) < 0.5, 0, 2)


def test_frames_along_the_last_axis_are_reported():
    with pytest.warns(jl.JotlightWarning, match=r"8 frames of 128 x 100 jots.*\(array, 2, 0\)$"):
        jl.Bits.from_array(HWT)
    jl.Bits.from_array(HWT, jl.Sensor(frames=128))
    jl.Bits.from_array(np.ones((63, 200, 2), bool))
    jl.Bits.from_array(np.ones((1, 200, 2), bool))


@pytest.mark.parametrize("shape", [(64, 64, 1000), (32, 32, 257)])
def test_many_frames_along_the_last_axis_are_reported(shape):
    message = rf"if these are {shape[2]} frames of {shape[0]} x {shape[1]} jots, .*\(array, 2, 0\)$"
    with pytest.warns(jl.JotlightWarning, match=message):
        jl.Bits.from_array(np.ones(shape, bool))
    jl.Bits.from_array(np.ones(shape, bool), jl.Sensor(frames=shape[0]))


@pytest.mark.parametrize("shape", [(64, 64, 512), (63, 64, 1000), (64, 63, 1000), (16, 16, 1000)])
def test_frames_in_strips_are_not_reported(shape):
    assert len(jl.Bits.from_array(np.ones(shape, bool))) == shape[0]


def test_a_sensor_with_the_frames_of_the_last_axis_is_advised_to_move_it():
    sensor = jl.Sensor(frames=8)
    message = r"8 frames, got 128; if the frames are the last axis, .*: (np.*); otherwise take"
    with pytest.raises(ValueError, match=message) as error:
        jl.Bits.from_array(HWT, sensor)
    moved = eval(re.search(message, str(error.value))[1], {"np": np, "array": HWT})
    assert jl.Bits.from_array(moved, sensor).shape == (8, 128, 100)


@pytest.mark.parametrize("sensor", ["sensor", 4])
def test_what_is_no_sensor_is_refused(sensor):
    with pytest.raises(TypeError, match=r"expected a jotlight\.Sensor, such as Sensor\(frames=2\)"):
        jl.Bits.from_array(np.ones((2, 3, 4), bool), sensor)


@pytest.mark.parametrize("path", ["a.npy", Path("a.npy")])
def test_a_path_is_no_array(path):
    with pytest.raises(TypeError, match=r"got .*; jotlight\.open\(path\) reads a capture"):
        jl.Bits.from_array(path)
