"""Rotated, mirrored, and transposed bits, without unpacking them."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.frames.orientation import orient_packed, transpose_packed
from reference import formats as twin


def random_bits(shape):
    return np.random.default_rng(0).random(shape) < 0.4


@pytest.mark.parametrize("shape", [(2, 8, 8), (3, 5, 13), (1, 1, 1), (2, 17, 9), (1, 24, 16)])
def test_packed_bits_are_transposed(shape):
    array = random_bits(shape)
    expected = twin.packed(array.swapaxes(1, 2))
    np.testing.assert_array_equal(transpose_packed(twin.packed(array), shape[2]), expected)


@pytest.mark.parametrize("shape", [(2, 5, 13), (3, 8, 16), (2, 3, 11, 3)])
@pytest.mark.parametrize("flip", [None, "horizontal", "vertical"])
@pytest.mark.parametrize("degrees", [0, 90, 180, 270, -90, 450])
def test_packed_frames_are_rotated_and_mirrored(shape, degrees, flip):
    array = random_bits(shape)
    packed, width = orient_packed(twin.packed(array), shape[2], degrees // 90 % 4, flip)
    expected = twin.oriented(array, degrees, flip)
    assert jl.Bits(packed, width).shape == expected.shape
    np.testing.assert_array_equal(np.asarray(packed), twin.packed(expected))
