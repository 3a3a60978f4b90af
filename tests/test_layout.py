"""The axes of arrays of images."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jotlight.layout import Layout


@given(st.lists(st.integers(1, 4), max_size=2), st.integers(5, 7), st.integers(5, 8))
def test_a_stack_is_split_and_arranged_again(stack, height, width):
    array = np.arange(np.prod([*stack, height, width])).reshape(*stack, height, width)
    layout = Layout.of("image", array, None)
    assert layout.shape == tuple(stack)
    assert (layout.is_single, layout.is_stack) == (not stack, bool(stack))
    images = layout.split(array)
    assert images.shape == (layout.number, height, width)
    assert np.shares_memory(images, array)
    np.testing.assert_array_equal(layout.arrange(images), array)


@given(st.lists(st.integers(1, 3), max_size=2), st.integers(1, 5), st.integers(-3, 2))
def test_channels_are_split_and_arranged_again(stack, channels, place):
    shape = [*stack, 6, 7]
    axis = place if place < 0 else len(shape) - place
    shape.insert(len(shape) + 1 + axis if axis < 0 else axis, channels)
    array = np.arange(np.prod(shape)).reshape(shape)
    layout = Layout.of("image", array, axis)
    assert layout.shape == (*stack, channels)
    assert layout.is_stack == bool(stack)
    images = layout.split(array)
    assert images.shape == (np.prod([*stack, channels]), 6, 7)
    first = np.take(array, 0, axis=axis).reshape(-1, 6, 7)[0]
    np.testing.assert_array_equal(images[0], first)
    np.testing.assert_array_equal(layout.arrange(images), array)


@pytest.mark.parametrize(
    ("shape", "axis", "error", "message"),
    [
        ((5,), None, ValueError, r"expected shape \(H, W\) or \(..., H, W\)"),
        ((5, 0), None, ValueError, "at least one pixel"),
        ((5, 6), -1, ValueError, "three axes or more, with channels"),
        ((5, 6, 3), None, ValueError, "looks like color; pass channel_axis=-1"),
        ((9, 5, 6, 4), None, ValueError, "looks like color"),
        ((3, 50, 60), -1, ValueError, "looks like channels on the axis 0; pass channel_axis=0"),
        ((50, 60, 3), 0, ValueError, "looks like channels on the axis -1; pass channel_axis=-1"),
        ((5, 6, 3), 3, ValueError, "channel_axis: expected -3 to 2"),
        ((5, 6, 3), 0.5, TypeError, "whole number, such as -1, got 0.5"),
        ((5, 6, 3), True, TypeError, "whole number"),
    ],
)
def test_unclear_axes_are_refused(shape, axis, error, message):
    with pytest.raises(error, match=message):
        Layout.of("image", np.zeros(shape), axis)
