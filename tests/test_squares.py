"""Sums and means over squares of pixels, against loops."""

import numpy as np
import pytest

from jotlight.squares import mean_squares, repeat_squares, sum_squares


@pytest.mark.parametrize("beyond", ["edge", "empty"])
@pytest.mark.parametrize("side", [2, 3, 5])
@pytest.mark.parametrize("shape", [(1, 1), (6, 10), (2, 7, 9), (2, 1, 4, 3)])
@pytest.mark.parametrize("dtype", [bool, np.uint8, np.int32, np.float32, np.float64])
def test_sums_are_those_of_a_loop(shape, side, beyond, dtype):
    values = (255 * np.random.default_rng(0).random(shape)).astype(dtype)
    found = sum_squares(values, side, beyond=beyond)
    *stack, height, width = shape
    assert found.shape == (*stack, -(-height // side), -(-width // side))
    assert found.dtype == (values.dtype if values.dtype.kind == "f" else np.int64)
    for row, column in np.ndindex(found.shape[-2:]):
        places = [np.arange(side * index, side * (index + 1)) for index in (row, column)]
        if beyond == "edge":
            rows, columns = (
                np.minimum(each, length - 1)
                for each, length in zip(places, (height, width), strict=True)
            )
        else:
            rows, columns = (
                each[each < length] for each, length in zip(places, (height, width), strict=True)
            )
        square = values[..., rows[:, None], columns].astype(np.float64)
        np.testing.assert_allclose(found[..., row, column], square.sum(axis=(-2, -1)), rtol=1e-6)


@pytest.mark.parametrize("side", [1, 2, 3])
@pytest.mark.parametrize("shape", [(3, 3), (6, 10), (2, 7, 9), (2, 1, 4, 3)])
def test_means_are_those_of_whole_squares(shape, side):
    values = np.random.default_rng(0).random(shape).astype(np.float32)
    found = mean_squares(values, side)
    assert found.shape == (*shape[:-2], shape[-2] // side, shape[-1] // side)
    assert (found.dtype, mean_squares(values, side, np.float64).dtype) == (np.float32, np.float64)
    for row, column in np.ndindex(found.shape[-2:]):
        square = values[..., side * row : side * (row + 1), side * column : side * (column + 1)]
        np.testing.assert_allclose(found[..., row, column], square.mean(axis=(-2, -1)), rtol=1e-6)


@pytest.mark.parametrize("side", [1, 2, 3])
@pytest.mark.parametrize("shape", [(1, 1), (2, 5), (2, 3, 4)])
def test_all_pixels_of_a_square_have_its_value(shape, side):
    values = np.random.default_rng(0).random(shape)
    whole = repeat_squares(values, side)
    assert whole.shape == (*shape[:-2], side * shape[-2], side * shape[-1])
    for row, column in np.ndindex(whole.shape[-2:]):
        expected = values[..., row // side, column // side]
        np.testing.assert_array_equal(whole[..., row, column], expected)
    size = side * shape[-2] - side + 1, side * shape[-1]
    np.testing.assert_array_equal(repeat_squares(values, side, size), whole[..., : size[0], :])
