"""Frames between the times at which displacements are known."""

import functools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Times = Sequence[float] | npt.NDArray[np.float64]
"""Two or more times, increasing."""


def locate(
    frames: range | npt.NDArray[np.float64], times: Times
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float64]]:
    """Return the last of some times before each frame, but not the very last one, and its place.

    The place is from 0 at this time to 1 at the next time, or beyond for frames before the first
    and after the last time.

    Examples
    --------
    >>> index, place = locate(range(5), [1, 2, 4])
    >>> index.tolist(), place.tolist()
    ([0, 0, 1, 1, 1], [-1.0, 0.0, 0.0, 0.5, 1.0])
    """
    times, frames_of = np.asarray(times, np.float64), np.asarray(frames)
    index = np.searchsorted(times[1:-1], frames_of, "right")
    return index, (frames_of - times[index]) / (times[index + 1] - times[index])


@functools.lru_cache(maxsize=64)
def places_of(frames: range, times: tuple[float, ...]) -> npt.NDArray[np.float64]:
    """Return the places of frames between some times: n at the nth of them, from 0.

    Blocks are counted again along better motions, so these are kept. The array cannot be changed.

    Examples
    --------
    >>> places_of(range(5), (1, 2, 4)).tolist()
    [-1.0, 0.0, 1.0, 1.5, 2.0]
    """
    index, place = locate(frames, times)
    places = np.asarray(index + place)
    places.flags.writeable = False
    return places
