"""The firing rate over time: the fraction of ones of a few frames in each of many intervals."""

import math

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits import Bits
from jotlight.view.viewed import Check, Viewable

POINTS = 512
"""Maximum number of points of the plot."""

_MAX_BYTES = 1 << 25
"""Maximum number of bytes that are read for the plot."""


def firing_rates(
    viewed: Viewable, check: Check = lambda: None
) -> tuple[npt.NDArray[np.float32], int]:
    """Return the fraction of ones over time, and the number of frames behind each point.

    The capture is divided into at most 512 intervals, and the first frames of each are counted.

    Raises
    ------
    CancelledError
        When `check` raises it.

    Examples
    --------
    >>> from jotlight.view.viewed import Viewed
    >>> bits = Bits.from_array(np.arange(4)[:, None, None] >= np.full((1, 1, 8), 2))
    >>> rates, frames = firing_rates(Viewed.from_bits(bits))
    >>> rates.tolist(), frames
    ([0.0, 0.0, 1.0, 1.0], 1)
    """
    frames = viewed.frames
    points = min(POINTS, len(frames))
    edges = [frames.start + len(frames) * index // points for index in range(points)]
    size = _frame_bytes(viewed, frames.start)
    each = max(1, min(len(frames) // points, _MAX_BYTES // max(1, points * size)))
    rates = np.empty(points, np.float32)
    for index, start in enumerate(edges):
        check()
        rates[index] = fraction_of_ones(viewed, range(start, start + each))
    return rates, each


def fraction_of_ones(viewed: Viewable, frames: range) -> float:
    """Return the fraction of ones of a range of frames."""
    part = viewed.part(frames)
    if isinstance(part, Bits):
        ones = int(part.counts(1).sum(dtype=np.int64))
        return ones / math.prod(part.shape)
    counts = part.sum()
    return float(counts.mean(dtype=np.float64)) / viewed.sensor(len(frames)).trials


def _frame_bytes(viewed: Viewable, frame: int) -> int:
    part = viewed.part(range(frame, frame + 1))
    return part.packed.nbytes if isinstance(part, Bits) else part.images.nbytes
