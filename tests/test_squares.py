"""Sums over squares of pixels, against a loop."""

import numpy as np
import pytest

from jotlight.squares import sum_squares


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
