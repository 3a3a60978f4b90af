"""The channels of color arrays."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.channels import channel_views, stack_channels
from jotlight.sensing.pixel_counts import map_channels, split_channels

IMAGE = np.arange(24).reshape(2, 4, 3)


def test_the_channels_of_an_image_are_views():
    views = channel_views(IMAGE)
    assert len(views) == 3
    for index, view in enumerate(views):
        np.testing.assert_array_equal(view, IMAGE[..., index])
        assert np.shares_memory(view, IMAGE)


def test_a_gray_array_is_its_own_only_channel():
    assert channel_views(IMAGE[..., 0])[0].shape == (2, 4)
    assert channel_views(IMAGE, dimensions=3)[0] is IMAGE


def test_stacking_undoes_splitting():
    np.testing.assert_array_equal(stack_channels(channel_views(IMAGE), color=True), IMAGE)
    np.testing.assert_array_equal(stack_channels([IMAGE[..., 0]], color=False), IMAGE[..., 0])


@pytest.mark.parametrize("channels", [(), (1,), (3,)])
def test_a_method_runs_on_the_counts_of_each_channel(channels):
    counts = np.arange(8 * max(1, *channels, 0)).reshape(2, 4, *channels)
    assert all(each.flags.c_contiguous for each in split_channels(counts))
    doubled = map_channels(lambda each: 2 * each, counts)
    np.testing.assert_array_equal(doubled, 2 * counts)


@pytest.mark.parametrize("channels", [(), (1,), (3,)])
def test_a_method_runs_on_the_bits_of_each_channel(channels):
    bits = jl.Sensor(frames=5).expose(np.full((2, 4, *channels), 0.5), rng=0)
    counts = map_channels(lambda each: each.counts(), bits)
    np.testing.assert_array_equal(counts, bits.counts())
