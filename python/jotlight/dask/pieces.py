"""The division of windows among workers.

A task makes the images of a *group* of windows. If their frames lie in several chunks, they are cut
into *pieces* at the beginning and the end of each window and of each chunk. The ones of each piece
are counted where the chunk is, and another task adds the counts. Only counts or estimates move
between workers, never frames.
"""

import dataclasses
import itertools
import math
import os
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight._engine import __version__
from jotlight.checks import whole_number
from jotlight.chunks import windows
from jotlight.runs.chunk_counting import (
    PART_BYTES,
    count_pieces,
    count_windows,
    image_shape,
    sum_pieces,
)
from jotlight.runs.spans import Spans
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.lazy import FrameSource, files_of, import_dask_array
from jotlight.sensing.bits.readings import Readings

if TYPE_CHECKING:
    import dask.array

    from jotlight.runs.estimator import Estimator

MAX_BYTES = 1 << 27
"""Maximum size of the counts of a task, unless those of one window are larger."""

_FAST_CHUNK, _FAST_CHUNKS = 1 << 30, 4
"""Largest chunk of bits if their estimate is about as fast as counting, and the number of smaller
chunks. Workers wait for the scheduler between chunks."""

_OVERLAP = 3
"""Number of images of counts for each of several windows that overlap: their sum, and the counts of
a piece at the beginning and of one at the end."""


class Group(NamedTuple):
    """Windows that a task counts or estimates, and their frames in each chunk."""

    spans: Spans
    chunks: list[tuple[int, range]]
    """The number of each chunk, and its frames that belong to the windows."""


@dataclasses.dataclass(frozen=True)
class Pieces:
    """A lazy array of packed bits, and the division of its windows among workers.

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
    groups : list of Group
        All windows.
    files : FrameSource, optional
        The files of the bits. Workers then read them without `x`.

    Examples
    --------
    >>> bits = jl.Bits.from_array(np.ones((100, 16, 16), bool))
    >>> pieces = Pieces.of(bits.to_dask(chunks=48), window=32, width=16)
    >>> [group.chunks for group in pieces.groups]
    [[(0, range(0, 48)), (1, range(48, 64))], [(1, range(64, 96))]]
    """

    x: "dask.array.Array"
    spans: Spans
    width: int
    oversampling: int
    groups: list[Group]
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
            # Several tasks need a frame of windows that overlap. To map a frame again takes no
            # time, but to read or decompress it does, so it is read once for all of them.
            is_shared = spans.overlap and not _is_mapped(x)
            files = None if is_shared else files_of(x.packed)
            x = x.to_dask(_frames_of_chunk(x, spans, is_fast=is_fast and not is_shared))
        oversampling = 1 if oversampling is None else oversampling
        x = x[: spans.stop]
        image = image_shape(x.shape, width, oversampling)
        groups = _divide(spans, x.chunks[0], image, in_files=files is not None)
        return cls(x, spans, width, oversampling, groups, files)

    @property
    def image_shape(self) -> tuple[int, ...]:
        """The shape of the counts of a window, (H, W) or (H, W, C)."""
        return image_shape(self.x.shape, self.width, self.oversampling)

    def count(self) -> "dask.array.Array":
        """Return the counts of all windows, int32 of shape (N, H, W) or (N, H, W, C)."""
        return self._map(None, self.image_shape, np.int32)

    def estimate(self, estimator: "Estimator") -> "dask.array.Array":
        """Return the estimates of the counts of all windows.

        Each window is estimated as soon as it is counted, so its counts are still in the cache, and
        need no memory of their own.
        """
        shape = estimator.estimate_shape((1, *self.image_shape))[1:]
        return self._map(estimator, shape, np.float32)

    def _map(
        self, estimator: "Estimator | None", shape: tuple[int, ...], dtype: type[np.generic]
    ) -> "dask.array.Array":
        """Return the counts or estimates of all windows.

        The tasks are listed one by one. To derive them from the description that `map_blocks`
        makes takes the scheduler six times as long.
        """
        array = import_dask_array()
        from dask.base import tokenize
        from dask.highlevelgraph import HighLevelGraph

        options = self.width, self.oversampling, __version__
        data = self.x.name, self.x.chunks, self.files is None
        token = tokenize(*data, self.spans, *options, estimator)
        name, sources = f"windows-{token}", self._sources()
        graph: dict[tuple[Any, ...], tuple[Any, ...]] = {}
        for index, (spans, chunks) in enumerate(self.groups):
            key = (name, index, *(0 for _ in shape))
            if len(chunks) == 1:
                source = sources[chunks[0][0]]
                graph[key] = (count_windows, *source, spans, *options, estimator)
                continue
            parts = [(f"pieces-{token}", index, number) for number in range(len(chunks))]
            for part, (chunk, frames) in zip(parts, chunks, strict=True):
                graph[part] = (count_pieces, *sources[chunk], frames, spans, *options)
            every = [frames for _, frames in chunks]
            graph[key] = (sum_pieces, parts, every, spans, __version__, estimator)
        return array.Array(
            HighLevelGraph.from_collections(
                name, graph, dependencies=[self.x] if self.files is None else []
            ),
            name,
            (tuple(group.spans.number for group in self.groups), *((size,) for size in shape)),
            meta=np.empty((0,) * (1 + len(shape)), dtype),
        )

    def _sources(self) -> list[tuple[Any, range]]:
        """Return what tasks read each chunk from, and the numbers of the frames that this holds."""
        edges = np.cumsum([0, *self.x.chunks[0]]).tolist()
        if self.files is not None:
            return [(self.files, range(edges[-1]))] * (len(edges) - 1)
        zeros = (0,) * (self.x.ndim - 1)
        return [
            ((self.x.name, chunk, *zeros), range(*both))
            for chunk, both in enumerate(itertools.pairwise(edges))
        ]


def _is_mapped(bits: Bits) -> bool:
    """Return whether the frames are in memory, or are mapped into it."""
    return isinstance(bits.packed, np.ndarray) or bits.packed.mapped is not None


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


def _divide(
    spans: Spans, sizes: tuple[int, ...], image: tuple[int, ...], *, in_files: bool
) -> list[Group]:
    """Return the groups of windows: those that begin in a chunk, or in several small chunks.

    A group is smaller if its counts exceed the limit. Its windows overlap those of the next group,
    so a frame is counted for several groups. To keep its counts would take more memory.

    Parameters
    ----------
    spans : Spans
        All windows.
    sizes : tuple of int
        The number of frames of each chunk.
    image : tuple of int
        The shape of the counts of a window.
    in_files : bool
        Whether tasks read files, so that they can read any frames.
    """
    images = 4 * int(np.prod(image, dtype=np.int64)) * (_OVERLAP if spans.overlap else 1)
    most, least = max(1, MAX_BYTES // images), max(1, spans.window // spans.step)
    edges, begin, groups = np.cumsum([0, *sizes]), 0, []
    reads_whole = in_files and spans.window <= max(sizes)
    for end in np.searchsorted(spans.starts, edges[1:]).tolist():
        if end - begin < least and end < spans.number:
            continue
        for first in range(begin, end, most):
            part = spans.part(first, min(first + most, end))
            group = Group(part, [(0, range(part.start, part.stop))])
            groups.append(group if reads_whole else Group(part, _in_chunks(part, edges)))
        begin = end
    return groups


def _in_chunks(spans: Spans, edges: npt.NDArray[np.int64]) -> list[tuple[int, range]]:
    """Return the number of each chunk with frames of windows, and these frames."""
    first = int(np.searchsorted(edges, spans.start, side="right")) - 1
    bounds = [
        spans.start,
        *edges[(edges > spans.start) & (edges < spans.stop)].tolist(),
        spans.stop,
    ]
    return [(first + index, range(*both)) for index, both in enumerate(itertools.pairwise(bounds))]
