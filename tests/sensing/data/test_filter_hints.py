"""Hints about the filters of a mosaic, from the mean rates of its jots."""

import numpy as np
import pytest

from jotlight.sensing.data.filter_hints import (
    alternating,
    green_orders,
    means_of_filters,
    white_order,
)


@pytest.mark.parametrize("side", [1, 2])
def test_the_means_are_those_of_each_filter(side):
    levels = np.array([[1.0, 2.0], [3.0, 5.0]], np.float32)
    rates = np.tile(levels.repeat(side, 0).repeat(side, 1), (4, 6))
    np.testing.assert_allclose(means_of_filters(rates[:-1], side), levels)


@pytest.mark.parametrize(
    ("levels", "greens", "white", "direction"),
    [
        ([[4, 9], [9, 1]], "as in RGGB or BGGR", None, None),
        ([[9, 4], [1, 9]], "as in GRBG or GBRG", None, None),
        ([[9, 4], [4, 1]], "as in RGGB or BGGR", None, None),  # a bright red filter
        ([[1, 1], [1, 3]], "as in RGGB or BGGR", "RGBW", None),
        ([[6, 10], [5, 21]], None, "RGBW", None),
        ([[1, 2], [1, 2]], None, None, "columns"),
        ([[1, 1], [2, 2]], None, None, "rows"),
        ([[6, 21], [10, 5]], "as in GRBG or GBRG", "RWGB", None),
    ],
)
def test_hints(levels, greens, white, direction):
    means = np.float32(levels)
    assert alternating(means) == direction
    assert white_order(means, green_orders(means) is not None) == white
    assert green_orders(means) == greens
