"""Numbers and maps as the engine expects them."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.bits.values import flatten


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
