"""Counts of many windows of frames, as a lazy array.

The frames are cut into *pieces* at the beginning and the end of each window and of each chunk. The
ones of each piece are counted once, where the chunk is. The counts of a window are the sum of those
of its pieces. Whole numbers are added, so the sum does not depend on the chunks. Only counts move
between workers, never frames.
"""

import dataclasses
import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight._engine import __version__
from jotlight.chunks import windows
from jotlight.dask.cluster import check_version
from jotlight.sensing.bits import Bits
from jotlight.sensing.channels import channel_views
from jotlight.sensing.frames import Packed
from jotlight.sensing.lazy import import_dask_array

if TYPE_CHECKING:
    import dask.array

_MAX_BYTES = 1 << 27
"""Maximum size of a chunk of counts, unless one image is larger."""

_MIN_CHUNK, _MAX_CHUNK, _CHUNKS = 1 << 27, 1 << 29, 8
"""Limits of the bytes of a chunk of bits, and the number of chunks between them. Workers wait for
the scheduler between chunks, for as long as the engine counts 50 to 100 MiB."""


@dataclasses.dataclass(frozen=True)
class Spans:
    """The frames of the windows: `number` windows of `window` frames, one from each `step`."""

    window: int
    step: int
    number: int

    @property
    def stop(self) -> int:
        """Number of frames up to the end of the last window."""
        return (self.number - 1) * self.step + self.window

    def pieces(self, start: int, stop: int) -> list[tuple[int, int]]:
        """Return the first frame and the end of each piece of the frames from `start` to `stop`.

        Examples
        --------
        >>> Spans(window=4, step=3, number=3).pieces(2, 12)
        [(2, 3), (3, 4), (4, 6), (6, 7), (7, 10)]
        >>> Spans(window=2, step=5, number=2).pieces(0, 7)
        [(0, 2), (5, 7)]
        """
        stop = min(stop, self.stop)
        first = max(0, (start - self.window) // self.step)
        last = min(self.number - 1, stop // self.step)
        begins = np.arange(first, last + 1) * self.step
        edges = np.unique(np.concatenate([[start, stop], begins, begins + self.window]))
        edges = edges[(edges >= start) & (edges <= stop)]
        inside = edges[:-1] % self.step < self.window
        # A window that overlaps the next one ends after the next one has begun.
        inside |= self.window > self.step
        return [
            (int(a), int(b))
            for a, b, is_inside in zip(edges[:-1], edges[1:], inside, strict=True)
            if is_inside
        ]


def count(
    x: "Bits | dask.array.Array",
    window: int,
    step: int | None = None,
    *,
    oversampling: int | None = None,
    width: int | None = None,
) -> "dask.array.Array":
    """Return L of each window of frames, the number of ones of each pixel, as a lazy array.

    Parameters
    ----------
    x : Bits or dask.array.Array of uint8, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
        Bits, or packed bits as :meth:`jotlight.Bits.to_dask` returns them. A chunk holds whole
        frames.
    window : int
        Number of frames of a window, from 1 to T.
    step : int, optional
        Frames from one window to the next. Default: the size of a window.
    oversampling : int, optional
        K̂. Default: that of the bits' own sensor, or 1.
    width : int, optional
        W: the true width in jots. Default: that of the bits, or a multiple of 8.

    Returns
    -------
    dask.array.Array of int32, shape (N, H / K̂, W / K̂) or (N, H / K̂, W / K̂, C)
        The counts of N windows. Its values do not depend on the chunks of `x`.

    Raises
    ------
    MissingExtraError
        When dask is not installed.
    TypeError, ValueError
        When `x` is not packed, its chunks do not hold whole frames, or a number is out of range.

    Notes
    -----
    Workers with another version of jotlight raise RuntimeError when the counts are computed.

    Examples
    --------
    >>> bits = Bits.from_array(np.ones((100, 16, 16), bool))
    >>> counts = count(bits.to_dask(chunks=30), window=32)
    >>> counts.shape, np.unique(counts.compute()).tolist()
    ((3, 16, 16), [32])
    """
    if isinstance(x, Bits):
        oversampling = oversampling or (x.sensor.oversampling if x.sensor else 1)
        width = width or x.width
        nbytes = x.packed.nbytes
        x = x.to_dask(f"{max(_MIN_CHUNK, min(_MAX_CHUNK, nbytes // _CHUNKS))}B")
    oversampling = oversampling or 1
    check_packed_array(x)
    width = 8 * x.shape[2] if width is None else width
    number = len(windows(x.shape[0], window, step))
    spans = Spans(window, step or window, number)
    shape = _image_shape(x.shape, width, oversampling)
    x = _limited(x[: spans.stop], spans, shape)
    bounds = np.cumsum([0, *x.chunks[0]])
    pieces = [spans.pieces(int(a), int(b)) for a, b in itertools.pairwise(bounds)]
    partial = x.map_blocks(
        _count_pieces,
        spans,
        width,
        oversampling,
        __version__,
        dtype=np.int32,
        chunks=(tuple(map(len, pieces)), *((size,) for size in shape)),
        meta=np.empty((0,) * x.ndim, np.int32),
        name=None,
    )
    whole = [(a, a + window) for a in range(0, number * spans.step, spans.step)]
    if all(pieces) and list(itertools.chain(*pieces)) == whole:
        return partial  # each piece is a window
    return _sum_pieces(partial, pieces, spans, max(x.chunks[0]))


def check_packed_array(x: Any) -> None:
    """Raise TypeError or ValueError unless `x` is a lazy array of packed bits, in whole frames."""
    array = import_dask_array()
    if not isinstance(x, array.Array) or x.dtype != np.uint8:
        kind = getattr(x, "dtype", type(x).__name__)
        raise TypeError(
            f"x: expected jotlight.Bits, or a dask array of packed bits in uint8, got {kind}; "
            "Bits.to_dask() returns such an array"
        )
    if x.ndim not in (3, 4) or 0 in x.shape:
        raise ValueError(
            f"x: expected shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C), got {x.shape}"
        )
    if any(len(sizes) > 1 for sizes in x.chunks[1:]):
        whole = (-1,) * (x.ndim - 1)
        raise ValueError(
            f"chunks: expected whole frames, got chunks of {x.chunksize} of frames "
            f"{x.shape[1:]}; x.rechunk({(x.chunksize[0], *whole)}) joins them"
        )


def _image_shape(shape: tuple[int, ...], width: int, oversampling: int) -> tuple[int, ...]:
    _, height, row_bytes, *channels = shape
    if not 8 * row_bytes - 8 < width <= 8 * row_bytes:
        raise ValueError(
            f"width: expected {8 * row_bytes - 7} to {8 * row_bytes} for {row_bytes} bytes a row, "
            f"got {width}"
        )
    if oversampling < 1 or height % oversampling or width % oversampling:
        raise ValueError(
            "bits: expected rows and columns of jots that are multiples of the oversampling "
            f"{oversampling}, got {height} x {width}"
        )
    return height // oversampling, width // oversampling, *channels


def _limited(x: "dask.array.Array", spans: Spans, shape: tuple[int, ...]) -> "dask.array.Array":
    """Return the array with smaller chunks if the counts of the pieces of one exceed the limit."""
    per_step = 1 if spans.step == spans.window else 2
    max_pieces = max(1, _MAX_BYTES // (4 * int(np.prod(shape, dtype=np.int64))))
    frames = max(1, max_pieces * spans.step // per_step)
    return x.rechunk({0: frames}) if max(x.chunks[0]) > frames else x


def _count_pieces(
    block: npt.NDArray[np.uint8],
    spans: Spans,
    width: int,
    oversampling: int,
    version: str,
    block_info: Any = None,
) -> npt.NDArray[np.int32]:
    """Return the counts of all pieces of a chunk. The worker must have the caller's version."""
    check_version(version)
    start, stop = block_info[0]["array-location"][0]
    # A file is mapped read-only, and the engine only reads.
    pieces = spans.pieces(start, stop)
    # One large array has large pages. New memory of small ones takes a quarter of the time of
    # counting.
    counts = np.empty((len(pieces), *_image_shape(block.shape, width, oversampling)), np.int32)
    for out, (a, b) in zip(counts, pieces, strict=True):
        out[...] = 0
        # The engine counts each piece in one call, because bit planes are fast for many frames.
        add_counts(block[a - start : b - start], width, oversampling, out, threads=1)
    return counts


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


def _sum_pieces(
    partial: "dask.array.Array",
    pieces: list[list[tuple[int, int]]],
    spans: Spans,
    chunk_frames: int,
) -> "dask.array.Array":
    """Return the sum of the counts of the pieces of each window."""
    array = import_dask_array()
    from dask.base import tokenize
    from dask.highlevelgraph import HighLevelGraph

    begins = np.array([a for chunk in pieces for a, _ in chunk])
    ends = np.array([b for chunk in pieces for _, b in chunk])
    firsts = np.cumsum([0, *map(len, pieces)])  # the first piece of each chunk
    image_bytes = 4 * int(np.prod(partial.shape[1:], dtype=np.int64))
    group = max(1, min(_MAX_BYTES // image_bytes, chunk_frames // spans.step))
    name = f"count-{tokenize(partial.name, spans)}"
    zeros = (0,) * (partial.ndim - 1)
    graph, sizes = {}, []
    for index, first in enumerate(range(0, spans.number, group)):
        starts = np.arange(first, min(first + group, spans.number)) * spans.step
        low = np.searchsorted(begins, starts)
        high = np.searchsorted(ends, starts + spans.window, side="right")
        chunk = int(np.searchsorted(firsts, low[0], side="right")) - 1
        last = int(np.searchsorted(firsts, high[-1] - 1, side="right")) - 1
        keys = [(partial.name, each, *zeros) for each in range(chunk, last + 1) if pieces[each]]
        offset = int(firsts[chunk])
        ranges = [(int(a) - offset, int(b) - offset) for a, b in zip(low, high, strict=True)]
        graph[(name, index, *zeros)] = (_add, keys, ranges)
        sizes.append(len(ranges))
    return array.Array(
        HighLevelGraph.from_collections(name, graph, dependencies=[partial]),
        name,
        (tuple(sizes), *partial.chunks[1:]),
        meta=np.empty((0,) * partial.ndim, np.int32),
    )


def _add(
    parts: list[npt.NDArray[np.int32]], ranges: list[tuple[int, int]]
) -> npt.NDArray[np.int32]:
    """Return the sum of each range of the images of some parts."""
    if len(parts) == 1 and ranges == [(i, i + 1) for i in range(len(parts[0]))]:
        return parts[0]
    images = [image for part in parts for image in part]
    out = np.zeros((len(ranges), *parts[0].shape[1:]), np.int32)
    for total, (first, stop) in zip(out, ranges, strict=True):
        for image in images[first:stop]:
            total += image
    return out
