"""What a worker does with frames: it counts or estimates the images of windows, or of pieces."""

import bisect
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Packed
from jotlight.runs.cluster import check_version
from jotlight.runs.reporting import naming_worker, warning_client
from jotlight.runs.spans import Spans
from jotlight.sensing.bits.bits_checks import checked_oversampling
from jotlight.sensing.bits.channels import channel_views
from jotlight.sensing.bits.lazy import FrameSource

if TYPE_CHECKING:
    from jotlight.runs.estimator import Estimator

PART_BYTES = 1 << 27
"""Bytes of the frames that a worker maps or reads at once."""

_CACHED_PIXELS = 1 << 18
"""Number of pixels that are counted and then estimated, unless an image has more. Their counts stay
in the processor's cache."""


def image_shape(shape: tuple[int, ...], width: int, oversampling: int) -> tuple[int, ...]:
    """Return the shape of the counts of packed frames, (H, W) or (H, W, C).

    Raises
    ------
    TypeError, ValueError
        When the width or the oversampling does not fit the frames.

    Examples
    --------
    >>> image_shape((100, 16, 3), width=24, oversampling=2)
    (8, 12)
    """
    _, height, row_bytes, *channels = shape
    if not 8 * row_bytes - 8 < width <= 8 * row_bytes:
        raise ValueError(
            f"width: expected {8 * row_bytes - 7} to {8 * row_bytes} for {row_bytes} bytes a row, "
            f"got {width}"
        )
    oversampling = checked_oversampling(oversampling, (height, width))
    return height // oversampling, width // oversampling, *channels


@naming_worker()
@warning_client()
def count_windows(
    source: FrameSource | npt.NDArray[np.uint8],
    chunk: range,
    spans: Spans,
    width: int,
    oversampling: int,
    version: str,
    estimator: "Estimator | None",
) -> npt.NDArray[np.int32] | npt.NDArray[np.float32]:
    """Return the counts of windows, or the estimates of an estimator for them.

    The source is all frames of a capture, or those of a chunk that contains the windows. The worker
    must have the caller's version.
    """
    check_version(version)
    frames = range(spans.start, spans.stop)
    if spans.overlap:
        partial = count_pieces(source, chunk, frames, spans, width, oversampling, version)
        return sum_pieces([partial], [frames], spans, version, estimator)
    pieces = spans.pieces(frames)
    shape = image_shape(source.shape, width, oversampling)
    parts = _Parts(source, chunk, pieces)
    # A table for large K has more values than there are pixels.
    is_short = spans.window <= parts.frames and spans.window * oversampling**2 < np.prod(shape)
    if estimator is not None and is_short and estimator.has_table:
        table = estimator.table()
        estimates = np.empty(estimator.estimate_shape((len(pieces), *shape)), np.float32)
        counts = np.empty((1, *shape), np.int32)
        _count(parts, pieces[:1], width, oversampling, counts)
        estimator(counts, estimates[:1], warns=True)
        for image, (a, b) in zip(estimates[1:], pieces[1:], strict=True):
            look_up_counts(parts.read(a, b), width, oversampling, table, image, threads=1)
        return estimates

    def write(first: int, counts: npt.NDArray[np.int32]) -> None:
        _count(parts, pieces[first : first + len(counts)], width, oversampling, counts)

    return _results(estimator, (len(pieces), *shape), write)


@naming_worker()
def count_pieces(
    source: FrameSource | npt.NDArray[np.uint8],
    chunk: range,
    frames: range,
    spans: Spans,
    width: int,
    oversampling: int,
    version: str,
) -> npt.NDArray[np.int32]:
    """Return the counts of the pieces of some frames, for windows of which other chunks have more.

    The source is all frames of a capture, or those of a chunk.
    """
    check_version(version)
    pieces = spans.pieces(frames)
    # One large array has large pages. New memory of small ones takes a quarter of the time of
    # counting.
    shape = image_shape(source.shape, width, oversampling)
    counts = np.empty((len(pieces), *shape), np.int32)
    _count(_Parts(source, chunk, pieces), pieces, width, oversampling, counts)
    return counts


@warning_client()
def sum_pieces(
    parts: list[npt.NDArray[np.int32]],
    frames: list[range],
    spans: Spans,
    version: str,
    estimator: "Estimator | None",
) -> npt.NDArray[np.int32] | npt.NDArray[np.float32]:
    """Return the counts of windows, or the estimates for them, from the counts of their pieces.

    The pieces of each part are those of some frames.
    """
    check_version(version)
    pieces = [piece for some in frames for piece in spans.pieces(some)]
    images = [image for part in parts for image in part]
    sums = _sums_of_ranges(images, spans.ranges(pieces))

    def write(first: int, counts: npt.NDArray[np.int32]) -> None:
        for image in counts:
            image[...] = next(sums)

    return _results(estimator, (spans.number, *parts[0].shape[1:]), write)


@warning_client()
def estimate_tile(counts: npt.NDArray[np.int32], estimator: "Estimator") -> npt.NDArray[np.float32]:
    """Return the estimates of a part of images, whose pixels do not depend on each other."""
    return estimator(counts, warns=True)


def _results(
    estimator: "Estimator | None",
    shape: tuple[int, ...],
    write: Callable[[int, npt.NDArray[np.int32]], None],
) -> npt.NDArray[np.int32] | npt.NDArray[np.float32]:
    """Return the counts of images of a shape (N, H, W) or (N, H, W, C), or the estimates of them.

    `write(first, counts)` writes the counts of the images from number `first`, in order.
    """
    if estimator is None:
        counts = np.empty(shape, np.int32)
        write(0, counts)
        return counts
    estimates = np.empty(estimator.estimate_shape(shape), np.float32)
    number, *image = shape
    group = max(1, _CACHED_PIXELS // int(np.prod(image)))
    counts = np.empty((min(group, number), *image), np.int32)
    for first in range(0, number, group):
        some = counts[: number - first]
        write(first, some)
        estimator(some, estimates[first : first + group], warns=first == 0)
    return estimates


def _sums_of_ranges(
    images: list[npt.NDArray[np.int32]], ranges: list[tuple[int, int]]
) -> Iterator[npt.NDArray[np.int32]]:
    """Yield the sum of each range of images, in the same array. Whole numbers have exact sums.

    If a range overlaps the one before, only the images that leave and enter it are added.
    """
    total, before, end = np.zeros_like(images[0]), 0, 0
    for first, stop in ranges:
        if first - before + stop - end < stop - first:
            for image in images[before:first]:
                total -= image
            for image in images[end:stop]:
                total += image
        else:
            total[...] = 0
            for image in images[first:stop]:
                total += image
        before, end = first, stop
        yield total


def _count(
    parts: "_Parts",
    pieces: list[tuple[int, int]],
    width: int,
    oversampling: int,
    out: npt.NDArray[np.int32],
) -> None:
    """Write the counts of some pieces into `out`."""
    for image, (a, b) in zip(out, pieces, strict=True):
        image[...] = 0
        # The engine counts many frames in one call, because bit planes are then fast. A file is
        # mapped read-only, and the engine only reads.
        for start in range(a, b, parts.frames):
            some = parts.read(start, min(start + parts.frames, b))
            add_counts(some, width, oversampling, image, threads=1)


class _Parts:
    """The frames of pieces. Those in files are mapped or read in parts of whole pieces.

    Parameters
    ----------
    source : FrameSource or ndarray of uint8
        All frames of a capture, or those of a chunk.
    chunk : range
        The numbers of the frames of the source.
    pieces : list of (int, int)
        The first frame and the end of each piece.
    """

    def __init__(
        self,
        source: FrameSource | npt.NDArray[np.uint8],
        chunk: range,
        pieces: list[tuple[int, int]],
    ) -> None:
        self._source, self._ends = source, [end for _, end in pieces]
        self.frames = max(1, PART_BYTES // max(1, int(np.prod(source.shape[1:]))))
        """Number of frames that are mapped or read at once."""
        self._known, self._part = range(0), np.empty(0, np.uint8)
        if not isinstance(source, FrameSource):
            self._known, self._part = chunk, source

    def read(self, start: int, stop: int) -> npt.NDArray[np.uint8]:
        """Return at most `frames` frames of a piece. They follow those that were read before.

        Raises
        ------
        RuntimeError
            When the source has fewer frames.
        """
        if stop > self._known.stop:
            last = bisect.bisect_right(self._ends, start + self.frames)
            end = max(stop, self._ends[last - 1] if last > 0 else stop)
            self._part = np.empty(0, np.uint8)  # Its memory is free before the next part is read.
            self._known, self._part = range(start, end), self._source[start:end]
        part = self._part[start - self._known.start : stop - self._known.start]
        if len(part) != stop - start:
            raise RuntimeError(
                f"expected frames {start} to {stop} of a chunk, got {len(part)} of them; open the "
                "capture again"
            )
        return part


def add_counts(
    packed: Packed,
    width: int,
    oversampling: int,
    out: npt.NDArray[np.int32],
    threads: int | None = None,
) -> None:
    """Add the number of ones of each pixel to `out`, (H, W) or (H, W, C).

    Examples
    --------
    >>> out = np.zeros((1, 8), np.int32)
    >>> add_counts(np.full((3, 1, 1), 0b10000001, np.uint8), 8, 1, out)
    >>> out.tolist()
    [[3, 0, 0, 0, 0, 0, 0, 3]]
    """
    views: list[Any] = channel_views(packed, 3)
    stack = out[None]
    for channel, place in zip(views, channel_views(stack, 3), strict=True):
        engine.add_block_counts([channel], width, oversampling, None, place, threads)


def look_up_counts(
    packed: Packed,
    width: int,
    oversampling: int,
    table: npt.NDArray[np.float32],
    out: npt.NDArray[np.float32],
    threads: int | None = None,
) -> None:
    """Write the value in a table of the number of ones of each pixel to `out`.

    Examples
    --------
    >>> out = np.zeros((1, 8), np.float32)
    >>> table = np.array([0.5, 1, 2, 4], np.float32)
    >>> look_up_counts(np.full((3, 1, 1), 0b10000001, np.uint8), 8, 1, table, out)
    >>> out.tolist()
    [[4.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 4.0]]
    """
    views: list[Any] = channel_views(packed, 3)
    for channel, place in zip(views, channel_views(out), strict=True):
        engine.look_up_counts(channel, width, oversampling, table, place, threads)
