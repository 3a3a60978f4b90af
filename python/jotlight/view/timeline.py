"""The readings over time: the mean reading of a few frames in each of many intervals."""

import numpy as np
import numpy.typing as npt

from jotlight.view.viewed import Check, Viewable, count_frames, frame_bytes

POINTS = 512
"""Maximum number of points of the plot."""

_MAX_BYTES = 1 << 25
"""Maximum number of bytes that are read for the plot."""


def firing_rates(
    viewed: Viewable, check: Check = lambda: None
) -> tuple[npt.NDArray[np.float32], int]:
    """Return the mean reading over time, and the number of frames behind each point.

    For bits, it is the fraction of ones. The capture is divided into at most 512 intervals of whole
    cycles of exposures, and the first frames of each are counted.

    Raises
    ------
    CancelledError
        When `check` raises it.

    Examples
    --------
    >>> from jotlight.view.viewed import Viewed
    >>> bits = jl.Bits.from_array(np.arange(4)[:, None, None] >= np.full((1, 1, 8), 2))
    >>> rates, frames = firing_rates(Viewed.from_data(bits))
    >>> rates.tolist(), frames
    ([0.0, 0.0, 1.0, 1.0], 1)
    """
    frames, cycle = viewed.frames, viewed.cycle
    number = len(frames) // cycle
    points = min(POINTS, number)
    edges = [frames.start + cycle * (number * index // points) for index in range(points)]
    size = points * cycle * frame_bytes(viewed)
    each = cycle * max(1, min(number // points, _MAX_BYTES // size))
    rates = np.empty(points, np.float32)
    readings = viewed.sensor(each).trials
    for index, start in enumerate(edges):
        check()
        counts = count_frames(viewed, range(start, start + each))
        rates[index] = counts.mean(dtype=np.float64) / readings
    return rates, each
