"""Scores of velocities, from the correlations of all pairs of some blocks of frames.

If a part of a scene moves at the velocity v, the correlations of blocks that are n frames apart
have their peaks at n v. So the score of v is their sum at these places. Other parts of the scene
may have other velocities, so there are also scores of windows.
"""

import itertools
from collections.abc import Sequence

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import Array, Array32, Counts

MAX_BLOCKS = 32
"""Maximum number of blocks that are correlated."""

BIN = 2
"""Width of the squares whose counts are added, in pixels. Finer details hardly correlate."""

MIN_PEAK = 3.0
"""Minimum height of a peak, in standard deviations of the scores."""

WINDOW = 96 // BIN
"""Width of a window in bins."""

BAND = 1.0 / BIN, 12.0 / BIN
"""Standard deviations of the filters between which details are correlated, in bins."""

_RANGE = 0.45
"""Maximum displacement between two blocks, as a fraction of the width of a window."""


class VelocityScores:
    """Scores of the velocities in a scene.

    Parameters
    ----------
    blocks : ndarray of int32, shape (n, h, w)
        Counts of two or more blocks, or what remains of them, in bins of 2 x 2 pixels.
    frames : float
        Frames from one block to the next.
    lags : sequence of int
        Distances in blocks of the pairs that are correlated, from 1 upward. Those of n or more have
        no pairs, and are left out.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Attributes
    ----------
    line : ndarray of float, shape (m,)
        The velocities in rows and in columns that have scores, in pixels per frame.
    """

    def __init__(
        self, blocks: Counts, frames: float, lags: Sequence[int], threads: int | None
    ) -> None:
        self._blocks, self._threads = blocks, threads
        self._lags = [lag for lag in lags if lag < len(blocks)]
        height, width = blocks.shape[1:]
        self._window = min(height, WINDOW), min(width, WINDOW)
        steps = int(_RANGE * min(self._window))
        self._places = np.arange(-steps, steps + 1) / self._lags[-1]
        self.line: Array = BIN * self._places / frames

    def of_whole_image(self) -> Array32:
        """Return the scores of the whole image, (m, m), from pairs at all distances."""
        size = self._blocks.shape[1], self._blocks.shape[2]
        every = list(range(1, self._lags[-1] + 1))
        return np.asarray(self._scores([(0, 0)], size, every)[0])

    def of_windows(self, stride: int) -> tuple[Array32, Array]:
        """Return the scores of windows, (k, m, m), and the centers of these, (k, 2).

        The windows overlap, and cover the image. The centers are in pixels, relative to that of the
        image.

        Parameters
        ----------
        stride : int
            Maximum distance of neighboring windows, in bins.
        """
        height, width = self._blocks.shape[1:]
        rows, columns = window_starts(height, stride), window_starts(width, stride)
        corners = list(itertools.product(rows, columns))
        centers = BIN * (np.array(corners) + (np.array(self._window) - (height, width)) / 2)
        return self._scores(corners, self._window, self._lags), centers

    def _scores(
        self, corners: list[tuple[int, int]], size: tuple[int, int], lags: list[int]
    ) -> Array32:
        """Return the scores of windows of a size in bins."""
        blocks, places = self._blocks, self._places
        return engine.velocity_scores(blocks, corners, size, BAND, lags, places, self._threads)


def window_starts(length: int, stride: int) -> list[int]:
    """Return the first rows or columns of windows that overlap and cover a length, in bins.

    Examples
    --------
    >>> [window_starts(length, 32) for length in (30, 128)]
    [[0], [0, 27, 53, 80]]
    """
    number = 1 + max(0, -(-(length - WINDOW) // stride))
    return [round(start) for start in np.linspace(0, max(0, length - WINDOW), number)]
