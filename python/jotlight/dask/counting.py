"""Counts of many windows of frames, as a lazy array.

The counts of a window are the sum of those of its pieces (:mod:`jotlight.dask.pieces`). Whole
numbers are added, so the sum does not depend on the chunks.
"""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from jotlight.dask.pieces import MAX_BYTES, Pieces
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.lazy import import_dask_array

if TYPE_CHECKING:
    import dask.array


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
        W: the true width in jots, such as ``bits.width``. An array of packed bits needs it, because
        its rows are padded to whole bytes. Default: that of the bits.

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
    >>> bits = jl.Bits.from_array(np.ones((100, 16, 16), bool))
    >>> counts = count(bits.to_dask(chunks=30), window=32, width=bits.width)
    >>> counts.shape, np.unique(counts.compute()).tolist()
    ((3, 16, 16), [32])
    """
    return sum_pieces(Pieces.of(x, window, step, oversampling=oversampling, width=width))


def sum_pieces(pieces: Pieces) -> "dask.array.Array":
    """Return the sum of the counts of the pieces of each window, (N, H, W) or (N, H, W, C)."""
    partial = pieces.count()
    return partial if pieces.are_windows else _sums(partial, pieces)


def _sums(partial: "dask.array.Array", pieces: Pieces) -> "dask.array.Array":
    """Return the sum of the counts of the pieces of each window, from those of all pieces."""
    array = import_dask_array()
    from dask.base import tokenize
    from dask.highlevelgraph import HighLevelGraph

    spans, in_chunks = pieces.spans, pieces.in_chunks
    begins = np.array([a for chunk in in_chunks for a, _ in chunk])
    ends = np.array([b for chunk in in_chunks for _, b in chunk])
    firsts = np.cumsum([0, *map(len, in_chunks)])  # the first piece of each chunk
    image_bytes = 4 * int(np.prod(partial.shape[1:], dtype=np.int64))
    chunk_frames = max(pieces.x.chunks[0])
    group = max(1, min(MAX_BYTES // image_bytes, chunk_frames // spans.step))
    name = f"count-{tokenize(partial.name, spans)}"
    zeros = (0,) * (partial.ndim - 1)
    graph, sizes = {}, []
    for index, first in enumerate(range(0, spans.number, group)):
        starts = np.arange(first, min(first + group, spans.number)) * spans.step
        low = np.searchsorted(begins, starts)
        high = np.searchsorted(ends, starts + spans.window, side="right")
        chunk = int(np.searchsorted(firsts, low[0], side="right")) - 1
        last = int(np.searchsorted(firsts, high[-1] - 1, side="right")) - 1
        keys = [(partial.name, each, *zeros) for each in range(chunk, last + 1) if in_chunks[each]]
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
