"""The pieces of a capture: frames between two edges of windows or of chunks.

The frames are cut into *pieces* at the beginning and the end of each window and of each chunk. The
ones of each piece are counted once, where the chunk is. Only counts or estimates move between
workers, never frames.
"""

import dataclasses
import itertools
import math
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from jotlight._engine import __version__
from jotlight.checks import whole_number
from jotlight.chunks import windows
from jotlight.dask.chunk_counting import PART_BYTES, count_pieces, image_shape
from jotlight.dask.spans import Spans
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.lazy import FrameSource, files_of, import_dask_array
from jotlight.sensing.bits.readings import Readings

if TYPE_CHECKING:
    import dask.array

    from jotlight.dask.estimator import Estimator

MAX_BYTES = 1 << 27
"""Maximum size of a chunk of counts, unless one image is larger."""

_FAST_CHUNK, _FAST_CHUNKS = 1 << 30, 4
"""Largest chunk of bits if their estimate is about as fast as counting, and the number of smaller
chunks. Workers wait for the scheduler between chunks."""


@dataclasses.dataclass(frozen=True)
class Pieces:
    """The pieces of a lazy array of packed bits, with what counts them.

    Parameters
    ----------
    x : dask.array.Array of uint8, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
        Packed bits.
    spans : Spans
        The frames of the windows.
    width : int
        W: the true width in jots.
    oversampling : int
        K̂.
    in_chunks : list of list of (int, int)
        The first frame and the end of each piece, for each chunk.
    files : FrameSource, optional
        The files of the bits. Workers then read them without `x`.

    Examples
    --------
    >>> bits = jl.Bits.from_array(np.ones((100, 16, 16), bool))
    >>> pieces = Pieces.of(bits.to_dask(chunks=48), window=32, width=16)
    >>> pieces.in_chunks
    [[(0, 32), (32, 48)], [(48, 64), (64, 96)]]
    >>> pieces.are_windows
    False
    """

    x: "dask.array.Array"
    spans: Spans
    width: int
    oversampling: int
    in_chunks: list[list[tuple[int, int]]]
    files: FrameSource | None = None

    @classmethod
    def of(
        cls,
        x: "Bits | dask.array.Array",
        window: int,
        step: int | None = None,
        *,
        oversampling: int | None = None,
        width: int | None = None,
        is_fast: bool = True,
    ) -> "Pieces":
        """Return the pieces of bits. The arguments are those of `jotlight.dask.count`.

        The chunks of :class:`jotlight.Bits` are larger if the estimate of their images `is_fast`.

        Raises
        ------
        TypeError, ValueError
            When `x` is not packed, its chunks do not hold whole frames, or a number is out of
            range.
        """
        width = width_in_jots(x, width)
        number = len(windows(x.shape[0], window, step))
        spans = Spans(window, step or window, number)
        files = None
        if isinstance(x, Bits):
            if oversampling is None and x.sensor is not None:
                oversampling = x.sensor.oversampling
            files = files_of(x.packed)
            x = x.to_dask(_frames_of_chunk(x, spans, is_fast=is_fast))
        oversampling = 1 if oversampling is None else oversampling
        x = _limited(x[: spans.stop], spans, image_shape(x.shape, width, oversampling))
        bounds = itertools.pairwise(np.cumsum([0, *x.chunks[0]]))
        in_chunks = [spans.pieces(int(a), int(b)) for a, b in bounds]
        return cls(x, spans, width, oversampling, in_chunks, files)

    @property
    def are_windows(self) -> bool:
        """Whether each piece is a whole window, and each chunk has some."""
        starts = range(0, self.spans.number * self.spans.step, self.spans.step)
        whole = [(a, a + self.spans.window) for a in starts]
        return all(self.in_chunks) and list(itertools.chain(*self.in_chunks)) == whole

    @property
    def image_shape(self) -> tuple[int, ...]:
        """The shape of the counts of a piece, (H, W) or (H, W, C)."""
        return image_shape(self.x.shape, self.width, self.oversampling)

    def count(self) -> "dask.array.Array":
        """Return the counts of all pieces, int32 of shape (N, H, W) or (N, H, W, C)."""
        return self._map(None, self.image_shape, np.int32)

    def estimate(self, estimator: "Estimator") -> "dask.array.Array":
        """Return the estimates of the counts of all pieces, which must be windows.

        Each piece is estimated as soon as it is counted, so its counts are still in the cache, and
        need no memory of their own.
        """
        shape = estimator.estimate_shape((1, *self.image_shape))[1:]
        return self._map(estimator, shape, np.float32)

    def _map(
        self, estimator: "Estimator | None", shape: tuple[int, ...], dtype: type[np.generic]
    ) -> "dask.array.Array":
        """Return the counts or estimates of all pieces, with one task for each chunk.

        The tasks are listed one by one. To derive them from the description that `map_blocks`
        makes takes the scheduler six times as long.
        """
        array = import_dask_array()
        from dask.base import tokenize
        from dask.highlevelgraph import HighLevelGraph

        options = (self.spans, self.width, self.oversampling, __version__, estimator)
        name = f"pieces-{tokenize(self.x.name, self.x.chunks, *options)}"
        zeros, graph = (0,) * (self.x.ndim - 1), {}
        for index, (a, b) in enumerate(itertools.pairwise(np.cumsum([0, *self.x.chunks[0]]))):
            source = (self.x.name, index, *zeros) if self.files is None else self.files
            key = (name, index, *(0 for _ in shape))
            graph[key] = (count_pieces, source, range(int(a), int(b)), *options)
        sources = [self.x] if self.files is None else []
        return array.Array(
            HighLevelGraph.from_collections(name, graph, dependencies=sources),
            name,
            (tuple(map(len, self.in_chunks)), *((size,) for size in shape)),
            meta=np.empty((0,) * (1 + len(shape)), dtype),
        )


def _frames_of_chunk(bits: Bits, spans: Spans, *, is_fast: bool) -> int:
    """Return the number of frames of a chunk: whole windows, if these do not overlap."""
    total = bits.packed.nbytes
    nbytes = max(PART_BYTES, min(_FAST_CHUNK, total // _FAST_CHUNKS)) if is_fast else PART_BYTES
    frames = max(1, nbytes * len(bits) // total)
    is_whole = spans.window <= spans.step <= frames
    return frames // spans.step * spans.step if is_whole else frames


def width_in_jots(x: "Bits | dask.array.Array", width: int | None) -> int:
    """Return the width of bits, or the stated one of packed bits.

    Raises
    ------
    TypeError, ValueError
        When `x` is no lazy array of packed bits in whole frames, its width is not stated, or the
        stated one is not that of bits.
    """
    width = None if width is None else whole_number("width", width, 1)
    if isinstance(x, Bits):
        if width not in (None, x.width):
            raise ValueError(f"width: expected {x.width}, that of the bits, got {width}")
        return x.width
    check_packed_array(x)
    if width is None:
        most = 8 * x.shape[2]
        raise TypeError(
            f"width: expected the width in jots, {most - 7} to {most}, because rows of "
            f"{x.shape[2]} packed bytes do not state it; pass width=bits.width, or bits in place "
            "of bits.to_dask()"
        )
    return width


def check_packed_array(x: Any) -> None:
    """Raise TypeError or ValueError unless `x` is a lazy array of packed bits, in whole frames."""
    if isinstance(x, Readings):
        raise TypeError(
            "x: expected jotlight.Bits, or a dask array of packed bits in uint8, got readings of "
            "several bits, which jotlight.dask does not take; jotlight.reconstruct takes them"
        )
    array = import_dask_array()
    if not isinstance(x, array.Array) or x.dtype != np.uint8:
        is_lazy, advice = isinstance(x, array.Array), "Bits.to_dask() returns such an array"
        kind = f"a dask array of {x.dtype}" if is_lazy else type(x).__name__
        if isinstance(x, str | os.PathLike):
            advice = "pass jotlight.open(path)"
        elif isinstance(x, np.ndarray):
            kind = f"an array of {x.dtype}"
            advice = "jotlight.Bits.from_array(frames, sensor) packs frames of bits"
        raise TypeError(
            f"x: expected jotlight.Bits, or a dask array of packed bits in uint8, got {kind}; "
            f"{advice}"
        )
    if any(map(math.isnan, x.shape)):
        raise ValueError(
            "x: expected chunks of known size, got unknown ones, such as those of a selection; "
            "x.compute_chunk_sizes() counts their frames"
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


def _limited(x: "dask.array.Array", spans: Spans, shape: tuple[int, ...]) -> "dask.array.Array":
    """Return the array with smaller chunks if the counts of the pieces of one exceed the limit."""
    per_step = 1 if spans.step >= spans.window else 2
    max_pieces = max(1, MAX_BYTES // (4 * int(np.prod(shape, dtype=np.int64))))
    frames = max(1, max_pieces * spans.step // per_step)
    return x.rechunk({0: frames}) if max(x.chunks[0]) > frames else x
