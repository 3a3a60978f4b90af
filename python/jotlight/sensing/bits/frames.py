"""Frames that are read from files when they are needed, so that captures may exceed memory."""

import bisect
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Packed
from jotlight.checks import shown
from jotlight.memory import check_memory

S = TypeVar("S")
T = TypeVar("T")


_MAX_BYTES = 1 << 23
"""Maximum number of bytes that are read at a time, unless one frame has more."""


class Frames:
    """A stack of frames in files, which is indexed like an array and read part by part.

    ``frames[a:b]`` selects frames, and ``frames[..., c]`` selects a channel. Both return
    :class:`Frames` and read nothing. ``frames[a:b, rows, ...]`` reads an array, and
    ``numpy.asarray(frames)`` reads everything.

    Parameters
    ----------
    shape : tuple of int
        (T, H, ...).
    read : callable
        ``read(start, stop)`` returns the frames of ``range(start, stop)`` as an array.
    dtype : dtype
        The type of that array.
    verify : callable, optional
        A function that raises ValueError if a file has changed since it was written. Reading does
        not call it, because it reads whole files; conversions do. Default: nothing can be verified.
    mapped : callable, optional
        ``mapped(start, stop)`` returns the same frames as ``read``, as a view of the file. Default:
        the file does not contain the frames as they are, so they cannot be mapped.

    Examples
    --------
    >>> frames = Frames((1000, 2, 3), lambda a, b: np.full((b - a, 2, 3), 7, np.uint8))
    >>> frames[10:12].shape, frames[10:12, :1].tolist()
    ((2, 2, 3), [[[7, 7, 7]], [[7, 7, 7]]])
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        read: Callable[[int, int], npt.NDArray[Any]],
        dtype: npt.DTypeLike = np.uint8,
        verify: Callable[[], object] = lambda: None,
        mapped: Callable[[int, int], npt.NDArray[Any]] | None = None,
    ) -> None:
        self.shape = tuple(map(int, shape))
        self.dtype = np.dtype(dtype)
        self.verify = verify
        self.mapped = mapped
        self._read = read
        self.origin: Callable[[], Any] | None = None
        self.selections: tuple[Any, ...] = ()

    @property
    def ndim(self) -> int:
        """Number of dimensions."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    @property
    def nbytes(self) -> int:
        """Number of bytes of the whole array."""
        return self.size * self.dtype.itemsize

    def __len__(self) -> int:
        return self.shape[0]

    def set_origin(self, origin: Callable[[], Any]) -> None:
        """Set the function that opens the same files again, for copies of these frames."""
        self.origin, self.selections = origin, ()

    def read(self, start: int, stop: int) -> npt.NDArray[Any]:
        """Return the frames from `start` to `stop` as an array.

        Raises
        ------
        ValueError
            When a file has changed since it was opened.
        """
        return self._checked(self._read(start, stop), stop - start)

    def map(self, start: int, stop: int) -> npt.NDArray[Any]:
        """Return the frames from `start` to `stop`, as a view of the file if possible.

        Mapping copies nothing. But the operating system kills a process that uses the map of a file
        that another program has shortened. So only lazy arrays, and the processes of a run that can
        be repeated, map files.

        Raises
        ------
        OSError, ValueError
            When a file has changed since it was opened.
        """
        return self._checked((self.mapped or self._read)(start, stop), stop - start)

    def _checked(self, part: npt.NDArray[Any], number: int) -> npt.NDArray[Any]:
        expected = (number, *self.shape[1:])
        if part.shape != expected or part.dtype != self.dtype:
            raise ValueError(
                f"expected frames of shape {expected} in {self.dtype}, got {part.shape} in "
                f"{part.dtype}; a file has changed since it was opened"
            )
        return part

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, slice):
            return self._select_frames(key)
        if not isinstance(key, tuple) or not key:
            raise TypeError(f"expected a slice of frames, or a tuple of slices, got {key!r}")
        if key[0] is Ellipsis:
            return self._select_part(key)
        if not isinstance(key[0], slice):
            raise TypeError(f"expected a slice of frames first, got {key[0]!r}")
        chosen = self._select_frames(key[0])
        # NumPy computes the shape of the result without using memory.
        shape = np.broadcast_to(np.uint8(0), chosen.shape)[(slice(None), *key[1:])].shape
        out = np.empty(shape, self.dtype)
        for place, part in read_in_chunks(chosen):
            out[place] = part[(slice(None), *key[1:])]
        return out

    def __array__(
        self, dtype: npt.DTypeLike | None = None, copy: bool | None = None
    ) -> npt.NDArray[Any]:
        if copy is False:
            raise ValueError("copy=False: frames in files can only be read into a new array")
        check_memory("frames", self.nbytes, "take a part of them, such as frames[:100]")
        array = self[:, ...]
        return np.asarray(array, dtype)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to open the files again for a copy, or else the content."""
        if self.origin is None:
            return np.asarray, (np.asarray(self),)
        return _open_again, (self.origin, self.selections, self.shape, self.dtype)

    def _select_frames(self, key: slice) -> "Frames":
        start, stop, step = key.indices(len(self))
        number = len(range(start, stop, step))
        read = self.read
        if step == 1:
            derived = self.derive(
                key, (number, *self.shape[1:]), lambda a, b: read(start + a, start + b)
            )
            if self.mapped is not None:
                derived.mapped = lambda a, b: self.map(start + a, start + b)
            return derived

        def read_each(a: int, b: int) -> npt.NDArray[Any]:
            indices = range(start + a * step, start + b * step, step)
            return np.concatenate([read(index, index + 1) for index in indices])

        return self.derive(key, (number, *self.shape[1:]), read_each)

    def _select_part(self, key: tuple[Any, ...]) -> "Frames":
        """Return the part of each frame that `key` selects, such as a channel."""
        shape = np.broadcast_to(np.uint8(0), self.shape)[key].shape
        if len(key) >= self.ndim + 1 or shape[0] != len(self):
            raise TypeError(f"expected a part of each frame, got {key!r}")
        return self.derive(key, shape, lambda a, b: self.read(a, b)[key])

    def derive(
        self, key: Any, shape: tuple[int, ...], read: Callable[[int, int], npt.NDArray[Any]]
    ) -> "Frames":
        """Return the frames that an index selects, or that a function makes of all of them."""
        derived = Frames(shape, read, self.dtype, self.verify)
        derived.origin, derived.selections = self.origin, (*self.selections, key)
        return derived


def _open_again(
    origin: Callable[[], Any],
    selections: tuple[Any, ...],
    shape: tuple[int, ...],
    dtype: npt.DTypeLike,
) -> Any:
    """Return the selected frames of files that are opened again.

    Raises
    ------
    ValueError
        When the files now hold other frames.
    """
    frames = origin()
    for key in selections:
        frames = key(frames) if callable(key) else frames[key]
    if frames.shape != shape or frames.dtype != dtype:
        raise ValueError(
            f"expected frames of shape {shape} in {dtype}, got {frames.shape} in {frames.dtype}; a "
            "file has changed since it was opened"
        )
    return frames


def frames_within(frames: npt.NDArray[Any] | Frames, max_bytes: int) -> int:
    """Return how many frames of a stack have at most this many bytes together, and at least 1.

    The number may exceed that of the frames, as the end of a slice may.

    Examples
    --------
    >>> frames = np.zeros((20, 4, 25), np.uint8)
    >>> frames_within(frames, 799), frames_within(frames, 99)
    (7, 1)
    """
    frame_bytes = max(1, frames.nbytes // max(1, len(frames)))
    return max(1, max_bytes // frame_bytes)


def read_in_chunks(
    frames: npt.NDArray[Any] | Frames, max_bytes: int = _MAX_BYTES
) -> Iterator[tuple[slice, npt.NDArray[Any]]]:
    """Yield all frames in order, as pairs of a slice and the array of these frames.

    An array has at least one frame. It has at most `max_bytes`, unless a single frame has more.
    """
    step = frames_within(frames, max_bytes)
    for start in range(0, len(frames), step):
        place = slice(start, min(start + step, len(frames)))
        yield place, read_frames(frames, place.start, place.stop)


def frame_index(name: str, index: object, number: int) -> int:
    """Return the index of one of a number of frames, from 0.

    Raises
    ------
    TypeError, IndexError
        For anything but a whole number, and when there is no such frame.

    Examples
    --------
    >>> frame_index("bits", -1, 8)
    7
    """
    # Arrays with one element have __index__, too.
    if isinstance(index, bool | np.bool_) or not isinstance(index, int | np.integer):
        raise TypeError(
            f"{name}: expected the number of a frame, or a slice such as {name}[:16], got "
            f"{shown(index)}; np.asarray({name}) is an array, which takes all indices of NumPy"
        )
    if not -number <= index < number:
        raise IndexError(f"{name}: expected a frame from 0 to {number - 1}, got {index}")
    return int(index) % number


def read_frames(frames: npt.NDArray[Any] | Frames, start: int, stop: int) -> npt.NDArray[Any]:
    """Return the frames from `start` to `stop` as an array. For an array, it is a view."""
    return frames.read(start, stop) if isinstance(frames, Frames) else frames[start:stop]


def read_chunks(
    packed: Packed | Frames, chunks: Iterable[tuple[range, range]]
) -> Iterator[tuple[range, Packed]]:
    """Yield the rows of each chunk, and its frames with all rows, which are read only once."""
    for frames, rows in chunks:
        if rows.start == 0:
            part = read_frames(packed, frames.start, frames.stop)
        yield rows, part


def check_unpacked_size(shape: tuple[int, ...], item_bytes: int = 1) -> None:
    """Raise MemoryError unless unpacked bits (T, H, W, ...) fit into the available memory."""
    check_memory(
        "bits",
        math.prod(shape) * item_bytes,
        "take a part of the frames (bits[:100]), iterate over them or over bits.windows(100), or "
        "count their ones: bits.counts()",
    )


def map_in_thread(function: Callable[[S], T], items: Iterable[S]) -> Iterator[T]:
    """Yield `function` of each item, computed in a thread while this thread makes the next item.

    Ctrl-C stops the making of an item, but it waits for the function.

    Examples
    --------
    >>> list(map_in_thread(len, ["a", "bc"]))
    [1, 2]
    """
    with ThreadPoolExecutor(1) as thread:
        running: Future[T] | None = None
        for item in items:
            if running is not None:
                yield running.result()
            running = thread.submit(function, item)
        if running is not None:
            yield running.result()


def concatenate(parts: Sequence[npt.NDArray[Any] | Frames]) -> npt.NDArray[Any] | Frames:
    """Return stacks of frames of the same shape as one stack, without reading them.

    Examples
    --------
    >>> zeros, ones = np.zeros((2, 1, 1), np.uint8), np.ones((3, 1, 1), np.uint8)
    >>> concatenate([zeros, ones])[1:3, 0, 0].tolist()
    [0, 1]
    """
    parts = [part for part in parts if len(part)] or list(parts[:1])
    if len(parts) == 1:
        return parts[0]
    ends = list(itertools.accumulate(map(len, parts)))

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        out = np.empty((stop - start, *parts[0].shape[1:]), parts[0].dtype)
        done = 0
        for index in range(bisect.bisect_right(ends, start), len(parts)):
            first = start + done - (ends[index] - len(parts[index]))
            take = min(stop - start - done, len(parts[index]) - first)
            out[done : done + take] = parts[index][first : first + take, ...]
            done += take
            if done == stop - start:
                break
        return out

    return Frames((ends[-1], *parts[0].shape[1:]), read, parts[0].dtype)
