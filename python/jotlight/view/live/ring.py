"""The most recent frames of a live capture, in a fixed amount of memory."""

import bisect
import threading
from collections import deque

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits import Bits
from jotlight.view.viewed import FramesGoneError

_MAX_BATCHES = 1 << 13
"""Maximum number of batches whose ones are kept for the plot of the firing rate."""

_POINTS = 512


class FrameRing:
    """The newest frames, which replace the oldest ones.

    Parameters
    ----------
    shape : tuple of int
        (H, ceil(W / 8)): the shape of a packed frame.
    width : int
        W.
    max_bytes : int
        Memory for frames. At least two frames are kept.
    first : int
        Number of the first frame that will be added.

    Examples
    --------
    >>> ring = FrameRing((1, 1), 8, max_bytes=3)
    >>> for value in range(5):
    ...     ring.append(np.full((1, 1, 1), value, np.uint8))
    >>> ring.frames, ring.read(range(3, 5)).ravel().tolist()
    (range(2, 5), [3, 4])
    """

    def __init__(self, shape: tuple[int, int], width: int, max_bytes: int, first: int = 0) -> None:
        self.shape, self.width = shape, width
        size = max(1, shape[0] * shape[1])
        self._frames = np.zeros((max(2, max_bytes // size), *shape), np.uint8)
        self._first = self._end = first
        self._lock = threading.Lock()
        self._ends: deque[int] = deque([first], _MAX_BATCHES)
        self._ones: deque[int] = deque([0], _MAX_BATCHES)

    @property
    def capacity(self) -> int:
        """Maximum number of frames."""
        return len(self._frames)

    @property
    def frames(self) -> range:
        """The numbers of the frames that can be read."""
        with self._lock:
            return range(self._first, self._end)

    def append(self, packed: npt.NDArray[np.uint8]) -> None:
        """Add frames (n, H, ceil(W / 8)). If there are too many, only the last ones stay."""
        ones = int(Bits(packed, self.width).counts(1).sum(dtype=np.int64))
        kept = packed[-self.capacity :]
        with self._lock:
            start = self._end + len(packed) - len(kept)
            place = start % self.capacity
            head = min(len(kept), self.capacity - place)
            self._frames[place : place + head] = kept[:head]
            self._frames[: len(kept) - head] = kept[head:]
            self._end += len(packed)
            self._first = max(self._first, self._end - self.capacity)
            self._ends.append(self._end)
            self._ones.append(self._ones[-1] + ones)

    def skip(self, number: int) -> None:
        """Count frames that are never read. Frames before them are no longer available."""
        with self._lock:
            self._end += number
            self._first = self._end
            self._ends = deque([self._end], _MAX_BATCHES)
            self._ones = deque([0], _MAX_BATCHES)

    def read(self, frames: range) -> npt.NDArray[np.uint8]:
        """Return a copy of some frames.

        Raises
        ------
        FramesGoneError
            When newer frames have replaced some of them, or they have not arrived.
        """
        with self._lock:
            if not self._first <= frames.start < frames.stop <= self._end:
                raise FramesGoneError(
                    f"frames: {frames.start} to {frames.stop - 1} are not in memory, which has "
                    f"{self._first} to {self._end - 1}; --history keeps more of them"
                )
            places = np.arange(frames.start, frames.stop) % self.capacity
            return self._frames[places]

    def rates(self) -> npt.NDArray[np.float32]:
        """Return the fraction of ones over time, at most 512 points over the available frames."""
        with self._lock:
            ends, ones = list(self._ends), list(self._ones)
            first, end = max(self._first, ends[0]), self._end
        start = max(0, bisect.bisect_right(ends, first) - 1)
        points = min(_POINTS, len(ends) - 1 - start, end - first)
        if points < 1:
            return np.zeros(0, np.float32)
        edges = np.linspace(first, end, points + 1)
        totals = np.interp(edges, ends[start:], ones[start:])
        jots = self.shape[0] * self.width
        return (np.diff(totals) / (np.diff(edges) * jots)).astype(np.float32)
