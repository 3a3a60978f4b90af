"""Frames that are drawn when they are read."""

import numpy as np
import pytest

from jotlight.datasets.moving_scenes.drawn_frames import drawn_once


def drawing(shape):
    """Return a function that draws frames of their own number, and the frames that it has drawn."""
    drawn = []

    def draw(start, stop):
        drawn.extend(range(start, stop))
        frames = np.arange(start, stop, dtype=np.uint16).reshape(-1, *[1] * (len(shape) - 1))
        return np.broadcast_to(frames, (stop - start, *shape[1:]))

    return draw, drawn


def test_each_frame_is_drawn_once():
    shape = (20, 3, 4)
    draw, drawn = drawing(shape)
    read = drawn_once(shape, np.uint16, draw)
    for start, stop in [(5, 8), (7, 12), (0, 20), (3, 3), (0, 20)]:
        part = read(start, stop)
        assert part.shape == (stop - start, 3, 4)
        np.testing.assert_array_equal(part[:, 2, 1], np.arange(start, stop))
    assert sorted(drawn) == list(range(20))


def test_frames_cannot_be_changed():
    shape = (4, 2, 2)
    read = drawn_once(shape, np.uint16, drawing(shape)[0])
    with pytest.raises(ValueError, match="read-only"):
        read(0, 2)[:] = 9
    assert read(0, 2).max() == 1


def test_long_scenes_are_not_kept():
    shape = (10_000, 256, 256)
    draw, _ = drawing(shape)
    assert drawn_once(shape, np.uint16, draw) is draw
