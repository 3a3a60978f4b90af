"""The edges of blocks: how the frames of a burst, or of a window of a film, are divided."""

import numpy as np
import numpy.typing as npt

_MIN_BLOCKS, _USUAL_BLOCKS = 16, 32
"""Minimum number of blocks, and their number from 256 to 1,024 frames."""

_FRAMES_OF_MANY = 1024
"""Above this number of frames, the number of blocks grows with the root of that of frames."""

_FRAMES_OF_BLOCK = 16
"""Frames of a block of a window. A window has fewer blocks than a burst, because most of its motion
is carried from the window before."""


def block_edges(frames: int) -> npt.NDArray[np.intp]:
    """Return the first frame of each block of a burst, and the number of its frames, (n + 1,).

    There are T/8 blocks, but at least 16. From 256 to 1,024 frames there are 32. More frames have
    32 √(T/1024) blocks, so that their number and their length both grow.

    Examples
    --------
    >>> [len(block_edges(frames)) - 1 for frames in (64, 200, 1000, 1_000_000)]
    [16, 25, 32, 1000]
    """
    number = int(np.clip(frames / 8, _MIN_BLOCKS, _USUAL_BLOCKS))
    number = round(number * max(1.0, frames / _FRAMES_OF_MANY) ** 0.5)
    return np.round(np.linspace(0, frames, min(number, frames) + 1)).astype(np.intp)


def window_edges(frames: int, step: int) -> npt.NDArray[np.intp]:
    """Return the first frame of each block of a window, and the number of its frames, (n + 1,).

    Blocks have about 16 frames, but there are about 16 blocks or more. From 512 frames on, there
    are about as many as those of :func:`block_edges`. If the step from one window to the next has
    about a block or more, it has a whole number of blocks, so that successive windows share blocks.
    So blocks may be up to half longer, and there are 13 of them in the first example.

    Examples
    --------
    >>> window_edges(64, 10).tolist()
    [0, 5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 64]
    >>> window_edges(256, 32).tolist() == list(range(0, 257, 16))
    True
    """
    most = len(block_edges(frames)) - 1
    length = frames / min(most, max(_MIN_BLOCKS, frames // _FRAMES_OF_BLOCK))
    if step >= length:
        length = step / round(step / length)
    elif step >= frames / most:
        length = step
    # Unlike np.round, this rounds all halves upward, so that edges have the same distances.
    edges = np.floor(np.arange(0, frames - length / 2, length) + 0.5).astype(np.intp)
    return np.append(edges, frames)
