"""Numbers and maps as the engine expects them."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.bits.values import flatten, numbers_of_ones


def test_a_contiguous_map_is_flattened_without_a_copy():
    map_ = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(flatten(map_), np.arange(6))
    assert flatten(map_).base is map_.base


def test_a_strided_map_is_flattened_in_row_major_order():
    np.testing.assert_array_equal(flatten(np.arange(6).reshape(3, 2).T), [0, 2, 4, 1, 3, 5])


def test_a_number_stays_a_number():
    assert flatten(0.5) == 0.5


@pytest.mark.parametrize("stack", [(2, 1, 1), (2, 1, 3), (2, 3, 1)])
def test_a_map_that_images_share_is_contiguous(stack):
    map_ = np.broadcast_to(np.full(stack[1:], 0.5), stack)
    flat = flatten(map_)
    assert flat.flags.c_contiguous
    assert flat.tolist() == [0.5] * map_.size


@pytest.mark.parametrize("values", [[0, 1], np.array([0, 1], np.uint64), [False, True]])
def test_numbers_of_ones_become_int32(values):
    array = numbers_of_ones(values)
    assert (array.dtype, array.tolist()) == (np.int32, [0, 1])


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ([0.0], TypeError, "ones: expected whole numbers, got float64"),
        (np.ma.array([1]), TypeError, "ones: expected a plain array"),
        ([-1], ValueError, r"ones: expected 0 to 2\*\*31 - 1, got -1 to -1"),
        ([2**31], ValueError, r"ones: expected 0 to 2\*\*31 - 1"),
    ],
)
def test_other_arrays_are_not_numbers_of_ones(values, error, message):
    with pytest.raises(error, match=message):
        numbers_of_ones(values)


def test_data_that_are_no_numbers_of_ones_are_named():
    readings = jl.Sensor(bit_depth=4).expose(np.full((4, 4), 0.5), rng=0)
    with pytest.raises(TypeError, match=r"got Readings of several bits; jotlight\.merge_readings"):
        jl.Likelihood(readings)
    with pytest.raises(
        TypeError, match=r"got Merged; .* its arrays, merged\.ones and merged\.trials"
    ):
        jl.Likelihood(jl.merge_readings(readings))
    with pytest.raises(TypeError, match="ones: expected whole numbers, got Sensor"):
        jl.Likelihood(jl.Sensor())


@pytest.mark.parametrize("data", [None, {"a": 1}, jl.Sensor()], ids=["None", "dict", "sensor"])
def test_the_error_of_data_without_numbers_names_their_type(data):
    for take in (jl.Bits.from_array, lambda data: jl.mle(data, jl.Sensor())):
        with pytest.raises(TypeError, match=f"got {type(data).__name__}"):
            take(data)
