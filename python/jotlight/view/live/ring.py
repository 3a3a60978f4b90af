"""The most recent frames of a live capture, in a fixed amount of memory."""

import threading
import time
from collections import deque

import numpy as np
import numpy.typing as npt

from jotlight.formats.format import FrameLayout
from jotlight.view.viewed import FramesGoneError

_POINTS = 512
"""Maximum number of points of the plot of the firing rate."""

_SAMPLE_SECONDS = 0.02
"""Minimum time between two frames whose ones are counted for the plot."""

_MAX_CHUNK_BYTES = 1 << 24
"""Maximum number of bytes that are read at once."""


class FrameRing:
    """The newest frames, which replace the oldest ones. They are decoded when they are viewed.

    So a frame that cannot be decoded, such as one of numbers that are no bits, is an error of the
    windows that contain it, and of nothing else.

    A reader writes bytes into the memory that :meth:`reserve` returns, and then calls
    :meth:`commit`.

    Parameters
    ----------
    layout : FrameLayout
        The layout of a raw frame.
    max_bytes : int
        Memory for frames. At least four frames are kept.
    first : int
        Number of the first frame that will be added.

    Examples
    --------
    >>> ring = FrameRing(FrameLayout((1, 1), 8, 1, lambda raw: raw.reshape(-1, 1, 1)), max_bytes=4)
    >>> for value in range(6):
    ...     ring.append(np.full((1, 1, 1), value, np.uint8))
    >>> ring.frames, ring.read(range(4, 6)).ravel().tolist()
    (range(2, 6), [4, 5])
    """

    def __init__(self, layout: FrameLayout, max_bytes: int, first: int = 0) -> None:
        self.layout = layout
        self.frame_bytes = layout.frame_bytes
        self.capacity = max(4, max_bytes // self.frame_bytes)
        """Maximum number of frames."""
        self._memory = np.zeros(self.capacity * self.frame_bytes, np.uint8)
        self._first = self._end = first
        self._partial = 0
        self._lock = threading.Lock()
        self._sample_step = max(1, self.capacity // _POINTS)
        self._sampled = 0.0
        self._samples: deque[tuple[int, float]] = deque(maxlen=_POINTS)

    @property
    def frames(self) -> range:
        """The numbers of the frames that can be read."""
        with self._lock:
            return range(self._first, self._end)

    @property
    def partial_bytes(self) -> int:
        """Number of bytes of a frame that has not arrived as a whole."""
        return self._partial

    def reserve(self) -> memoryview:
        """Return memory for the next bytes. The oldest frames give way to them."""
        chunk = max(1, min(_MAX_CHUNK_BYTES // self.frame_bytes, self.capacity // 4))
        with self._lock:
            self._first = max(self._first, self._end + chunk - self.capacity)
            place = self._end % self.capacity
            chunk = min(chunk, self.capacity - place)
        start = place * self.frame_bytes
        return self._memory[start + self._partial : start + chunk * self.frame_bytes].data

    def commit(self, size: int) -> None:
        """Add the frames that are complete after `size` more bytes."""
        whole, partial = divmod(self._partial + size, self.frame_bytes)
        with self._lock:
            self._end += whole
            self._partial = partial
        last = self._samples[-1][0] if self._samples else -self._sample_step
        now = time.monotonic()
        is_due = self._end - 1 >= last + self._sample_step
        if whole and is_due and now >= self._sampled + _SAMPLE_SECONDS:
            self._sampled = now
            self._sample(self._end - 1)

    def _sample(self, frame: int) -> None:
        """Count the ones of a frame, which is the newest one, for the plot."""
        place = frame % self.capacity * self.frame_bytes
        raw = self._memory[place : place + self.frame_bytes].reshape(1, -1)
        try:
            packed = self.layout.decode(raw)
        except ValueError:  # :meth:`read` raises it for each window with this frame
            return
        jots = np.unpackbits(packed, axis=2, count=self.layout.width)
        self._samples.append((frame, float(jots.mean())))

    def append(self, raw: npt.NDArray[np.uint8]) -> None:
        """Add raw frames, of any shape."""
        values = np.ascontiguousarray(raw).reshape(-1)
        while len(values):
            memory = self.reserve()
            size = min(len(memory), len(values))
            memory[:size] = values[:size].data
            self.commit(size)
            values = values[size:]

    def skip(self, number: int) -> None:
        """Count frames that are never read. Frames before them are no longer available."""
        with self._lock:
            self._end += number
            self._first = self._end
            self._samples.clear()

    def read(self, frames: range) -> npt.NDArray[np.uint8]:
        """Return packed frames (n, H, ceil(W / 8)).

        Raises
        ------
        FramesGoneError
            When newer frames have replaced some of them, or they have not arrived.
        ValueError
            When one of them cannot be decoded.
        """
        with self._lock:
            if not self._first <= frames.start < frames.stop <= self._end:
                raise FramesGoneError(
                    f"frames: {frames.start} to {frames.stop - 1} are not in memory, which has "
                    f"{self._first} to {self._end - 1}; --history keeps more of them"
                )
            rows = self._memory.reshape(self.capacity, self.frame_bytes)
            start = frames.start % self.capacity
            head = rows[start : start + len(frames)]
            raw = np.concatenate([head, rows[: len(frames) - len(head)]])
        return self.layout.decode(raw)

    def rates(self) -> npt.NDArray[np.float32]:
        """Return the fraction of ones of single frames at equal distances over the frames."""
        frames = self.frames
        samples = [each for each in list(self._samples) if each[0] >= frames.start]
        if len(samples) < 2:
            return np.zeros(0, np.float32)
        times, values = zip(*samples, strict=True)
        edges = np.linspace(frames.start, frames.stop, len(samples) + 1)
        rates = np.interp((edges[1:] + edges[:-1]) / 2, times, values)
        return np.asarray(rates, np.float32)
