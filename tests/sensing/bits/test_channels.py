"""The channels of color arrays."""

import numpy as np

from jotlight.sensing.bits.channels import channel_views, stack_channels

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
