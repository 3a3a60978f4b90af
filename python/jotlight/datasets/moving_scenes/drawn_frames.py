"""Frames that are drawn when they are read, and kept if memory holds all of them."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

_MAX_BYTES = 1 << 27
"""Frames of more bytes in total are drawn each time, so that long scenes need little memory."""

Draw = Callable[[int, int], npt.NDArray[Any]]


def drawn_once(shape: tuple[int, ...], dtype: npt.DTypeLike, draw: Draw) -> Draw:
    """Return a function that returns frames as `draw` does, but draws each of them only once.

    The arrays that it returns are read-only. If the frames have more than 128 MiB, it is `draw`.

    Parameters
    ----------
    shape : tuple of int
        (T, H, ...), the shape of all frames.
    dtype : dtype
        The type of the frames.
    draw : callable
        ``draw(start, stop)`` returns the frames of ``range(start, stop)``.

    Examples
    --------
    >>> read = drawn_once((9, 2, 2), np.uint8, lambda a, b: np.ones((b - a, 2, 2), np.uint8))
    >>> read(3, 5).shape
    (2, 2, 2)
    """
    if math.prod(shape) * np.dtype(dtype).itemsize > _MAX_BYTES:
        return draw
    frames = np.empty(shape, dtype)
    is_drawn = np.zeros(shape[0], np.bool_)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        for frame in (start + np.flatnonzero(~is_drawn[start:stop])).tolist():
            frames[frame : frame + 1] = draw(frame, frame + 1)
            is_drawn[frame] = True
        part = frames[start:stop]
        part.flags.writeable = False
        return part

    return read
