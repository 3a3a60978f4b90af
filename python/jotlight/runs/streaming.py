"""Counts of consecutive windows of a capture, read in parts of a few MiB, in constant memory."""

from collections import deque
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from isal import isal_zlib

from jotlight.array_types import Packed
from jotlight.runs.chunk_counting import add_counts
from jotlight.runs.spans import Spans
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames

_MAX_BYTES = 1 << 25
"""Number of bytes that are read and counted at a time. With fewer, the engine adds its bit planes
to the counts more often."""

_MAX_MAPPED_BYTES = 1 << 27
"""Number of bytes of a file that are mapped at a time. Large maps consist of large pages."""


_MAX_KEPT_BYTES = 1 << 28
"""Maximum number of bytes of frames that are kept in memory for the next windows."""


class Checksum:
    """The CRC-32 of bytes, as zlib computes it. Checksums of successive parts can be combined.

    Examples
    --------
    >>> first, second = Checksum(), Checksum()
    >>> first.update(np.frombuffer(b"1234", np.uint8))
    >>> second.update(np.frombuffer(b"56789", np.uint8))
    >>> first.append(second.value, second.size)
    >>> f"{first.value:08x}"
    'cbf43926'
    """

    def __init__(self) -> None:
        self.value, self.size = 0, 0

    def update(self, data: npt.NDArray[np.uint8]) -> None:
        """Add contiguous bytes."""
        self.value = isal_zlib.crc32(data, self.value)
        self.size += data.nbytes

    def append(self, value: int, size: int) -> None:
        """Add the checksum of the `size` bytes that follow."""
        self.value = isal_zlib.crc32_combine(self.value, value, size)
        self.size += size


class WindowCounter:
    """Counts of windows of the frames of a capture.

    Parameters
    ----------
    bits : Bits
    spans : Spans
        All windows of the capture.
    oversampling : int
        K̂.
    threads : int, optional
        The number of threads. Default: the number of cores.
    mapped : bool
        Whether files are mapped into memory, which is faster. See
        :meth:`jotlight.sensing.bits.frames.Frames.map`.
    """

    def __init__(
        self,
        bits: Bits,
        spans: Spans,
        oversampling: int,
        threads: int | None = None,
        *,
        mapped: bool = False,
    ) -> None:
        self.checksum = Checksum()
        """Checksum of the packed frames that entered windows, each frame once."""
        self._packed, self._width = bits.packed, bits.width
        self._spans, self._oversampling = spans, oversampling
        self._threads, self._mapped = threads, mapped
        self._last_map: tuple[int, Packed] = 0, np.empty((0, *bits.packed.shape[1:]), np.uint8)
        self._kept: deque[tuple[int, Packed]] = deque()
        frames, fits = spans.window + spans.step, _MAX_KEPT_BYTES // max(1, bits.packed[:1].nbytes)
        self._kept_frames = frames if spans.overlap and frames <= fits else 0
        _, height, width, *channels = bits.shape
        self._shape = (height // oversampling, width // oversampling, *channels)

    def windows(self, first: int, stop: int) -> Iterator[npt.NDArray[np.int32]]:
        """Yield the counts of the windows from number `first` to `stop`, (H, W) or (H, W, C)."""
        window, step = self._spans.window, self._spans.step
        counts = np.zeros(self._shape, np.int32)
        # The group before has read these frames of the first window.
        known = 0 if first == 0 else (first - 1) * step + window
        for number in range(first, stop):
            start, end = number * step, number * step + window
            if number > first and 2 * step < window:
                # Of most frames the counts are known: those of the window before.
                counts = self._count(end - step, end, counts.copy(), entering=True)
                counts -= self._count(start - step, start)
            else:
                counts = self._count(start, max(start, min(known, end)))
                counts = self._count(max(start, known), end, counts, entering=True)
            known = end
            yield counts

    def _count(
        self,
        start: int,
        stop: int,
        out: npt.NDArray[np.int32] | None = None,
        *,
        entering: bool = False,
    ) -> npt.NDArray[np.int32]:
        """Return the counts of some frames, added to `out`.

        If the frames enter a window, add them to the checksum.
        """
        out = np.zeros(self._shape, np.int32) if out is None else out
        for part in self._parts(start, stop):
            if entering:
                self.checksum.update(part)
            add_counts(part, self._width, self._oversampling, out, self._threads)
        return out

    def _parts(self, start: int, stop: int) -> Iterator[Packed]:
        """Yield some frames in parts of a few MiB."""
        packed, frame_bytes = self._packed, max(1, self._packed[:1].nbytes)
        small = max(1, _MAX_BYTES // frame_bytes)
        if not isinstance(packed, Frames):
            wholes = iter([packed[start:stop]])
        elif self._mapped and packed.mapped is not None:
            # Windows begin anywhere in a map, which the next window uses again.
            large = max(1, _MAX_MAPPED_BYTES // frame_bytes)
            firsts = range(start, stop, large)
            wholes = (self._map(first, min(first + large, stop), large) for first in firsts)
        else:
            wholes = self._read(packed, start, stop, small)
        for whole in wholes:
            for part in range(0, len(whole), small):
                yield np.ascontiguousarray(whole[part : part + small])

    def _read(self, packed: Frames, start: int, stop: int, small: int) -> Iterator[Packed]:
        """Yield some frames, from memory if a window before had them.

        To read frames again takes time, and in a compressed file, to read backward takes long.
        """
        kept = self._kept
        if kept and start < kept[0][0]:
            kept.clear()
        for first, part in list(kept):
            yield part[max(0, start - first) : max(0, stop - first)]
        known = kept[-1][0] + len(kept[-1][1]) if kept else start
        for first in range(max(start, known), stop, small):
            part = packed.read(first, min(first + small, stop))
            kept.append((first, part))
            yield part
            # The frames that leave the next window are not older.
            oldest = first + len(part) - self._kept_frames
            while kept and kept[0][0] + len(kept[0][1]) <= oldest:
                kept.popleft()

    def _map(self, start: int, stop: int, frames: int) -> Packed:
        """Return some frames as a view of the file, from the last map if it contains them."""
        assert isinstance(self._packed, Frames), "frames in a file"
        first, mapped = self._last_map
        if not first <= start <= stop <= first + len(mapped):
            last = min(start + frames, len(self._packed))
            first, mapped = self._last_map = start, self._packed.map(start, max(stop, last))
        return mapped[start - first : stop - first]
