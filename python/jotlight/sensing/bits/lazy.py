"""Packed bits as lazy arrays of dask, whose chunks the workers read from the files themselves."""

import dataclasses
import functools
import math
import mmap
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Packed
from jotlight.errors import ChangedFileError, import_extra
from jotlight.sensing.bits.frames import Frames

if TYPE_CHECKING:
    import dask.array

Chunks = str | int | tuple[int, ...]
"""The size of a chunk, its number of frames, or its shape."""

_KEPT = 4
"""Number of captures that a process keeps open."""


def import_dask_array() -> Any:
    """Return the module dask.array."""
    return import_extra("dask.array", "dask", "lazy arrays")


def to_dask(packed: Packed | Frames, chunks: Chunks) -> "dask.array.Array":
    """Return packed bits as a lazy array. See :meth:`jotlight.Bits.to_dask`."""
    array = import_dask_array()
    frames = frames_per_chunk(packed.shape, chunks)
    shape = (frames, *packed.shape[1:])
    if isinstance(packed, np.memmap):
        packed = _mapped_frames(packed)
    if isinstance(packed, np.ndarray):
        return array.from_array(packed, shape)
    source = FrameSource(packed, _name(packed))
    is_known = source.name is not None
    # Arrays with other chunks have other keys.
    name = f"{source.name}-{frames}" if is_known else False  # a random name
    # Each task names the files itself. As a task of its own, the source would travel from the
    # worker that gets it to all others, before they can begin.
    return array.from_array(source, shape, name=name, asarray=False, inline_array=is_known)


def files_of(packed: Packed | Frames) -> "FrameSource | None":
    """Return what reads frames in any process, or None if they are not in known files.

    Examples
    --------
    >>> files_of(np.zeros((4, 2, 3), np.uint8)) is None
    True
    """
    if isinstance(packed, np.memmap):
        packed = _mapped_frames(packed)
    if isinstance(packed, np.ndarray):
        return None
    name = _name(packed)
    return None if name is None else FrameSource(packed, name)


def _mapped_frames(packed: np.memmap[Any, np.dtype[np.uint8]]) -> Frames:
    """Return a map of a file as frames. dask would read the whole map to name it and to copy it.

    A copy in another process maps the file again, unless this process may write to the map.
    """
    read = packed.view(np.ndarray).__getitem__
    frames = Frames(packed.shape, lambda start, stop: read(slice(start, stop)))
    root: Any = packed
    while isinstance(root.base, np.memmap):
        root = root.base
    # A map that was computed from other arrays has no file, and the file of a map may be deleted.
    is_map = isinstance(root.base, mmap.mmap) and root.mode == "r" and root.filename is not None
    if is_map and (path := Path(root.filename).absolute()).is_file():
        position = root.offset + packed.ctypes.data - root.ctypes.data
        state = _state(path)
        origin = functools.partial(_map_again, path, state, position, packed.shape, packed.strides)
        frames.set_origin(origin)
    return frames


def _map_again(
    path: Path,
    state: tuple[int, int],
    position: int,
    shape: tuple[int, ...],
    strides: tuple[int, ...],
) -> Frames:
    """Return the frames of a map of a file, for a copy in another process.

    Raises
    ------
    ChangedFileError
        When the file has changed since its first map became a lazy array.
    """
    if _state(path) != state:
        raise ChangedFileError.of_file(path)
    whole = np.memmap(path, np.uint8, "r")
    part = np.ndarray(shape, np.uint8, whole, position, strides)
    frames = Frames(shape, lambda start, stop: part[start:stop])
    frames.set_origin(functools.partial(_map_again, path, state, position, shape, strides))
    return frames


def _state(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns


def frames_per_chunk(shape: tuple[int, ...], chunks: Chunks) -> int:
    """Return the number of frames in a chunk of packed bits of some shape.

    Raises
    ------
    TypeError, ValueError
        When a chunk does not hold whole frames.

    Examples
    --------
    >>> frames_per_chunk((1000, 512, 64), "1MiB"), frames_per_chunk((1000, 512, 64), (10, -1, -1))
    (32, 10)
    >>> frames_per_chunk((1000, 512, 64), "1KiB")
    Traceback (most recent call last):
      ...
    ValueError: chunks: expected at least 32768 bytes, which is one frame, got 1KiB
    """
    number, *frame = shape
    if isinstance(chunks, str):
        size, frame_bytes = _parse_bytes(chunks), math.prod(frame)
        if size < frame_bytes:
            raise ValueError(
                f"chunks: expected at least {frame_bytes} bytes, which is one frame, got {chunks}"
            )
        return min(number, size // frame_bytes)
    if isinstance(chunks, tuple):
        whole = len(chunks) == len(shape) and all(
            part in (-1, size) for part, size in zip(chunks[1:], frame, strict=True)
        )
        if not whole:
            example = (100, *(-1 for _ in frame))
            raise ValueError(
                f"chunks: expected whole frames, such as {example} for bits of shape {shape}, got "
                f"{chunks}"
            )
        chunks = number if chunks[0] == -1 else chunks[0]
    if isinstance(chunks, bool) or not isinstance(chunks, int | np.integer):
        raise TypeError(
            'chunks: expected a size such as "128MiB", a number of frames, or a shape, got '
            f"{chunks!r}"
        )
    if chunks < 1:
        raise ValueError(f"chunks: expected 1 frame or more, got {chunks}")
    return min(number, int(chunks))


def _parse_bytes(text: str) -> int:
    import_dask_array()
    from dask.utils import parse_bytes

    try:
        return int(parse_bytes(text))
    except ValueError as error:
        raise ValueError(f'chunks: expected a size such as "128MiB", got {text!r}') from error


class FrameSource:
    """Frames in files, as dask reads them. A copy in another process opens the files again.

    It opens them when it reads the first frames. dask makes copies in its schedulers, which need
    not see the files, and where workers receive messages: an error there would end the worker. A
    copy of frames without a name is an array of them.

    Parameters
    ----------
    frames : Frames
    name : str, optional
        A name of the state of the files. The copies in a process share the files that it opened.

    Examples
    --------
    >>> frames = Frames((1000, 2, 3), lambda a, b: np.full((b - a, 2, 3), 7, np.uint8))
    >>> FrameSource(frames)[10:12, :1].tolist()
    [[[7, 7, 7]], [[7, 7, 7]]]
    """

    def __init__(self, frames: "Frames | _UnopenedFrames", name: str | None = None) -> None:
        self.frames, self.name = frames, name
        self.shape, self.dtype, self.ndim = frames.shape, frames.dtype, len(frames.shape)

    def __reduce__(self) -> tuple[Any, ...]:
        if self.name is None:
            return np.asarray, (np.asarray(self.frames),)
        frames = self.frames
        if isinstance(frames, Frames):
            again = frames.__reduce__()
            frames = _UnopenedFrames(self.name, frames.shape, frames.dtype, *again)
        return FrameSource, (frames, self.name)

    def __getitem__(self, key: Any) -> npt.NDArray[np.uint8]:
        first, *rest = key if isinstance(key, tuple) else (key,)
        if isinstance(first, int | np.integer):
            return np.asarray(self.frames.map(int(first), int(first) + 1)[(0, *rest)])
        indices = range(*first.indices(self.shape[0]))
        if len(indices) == 0:
            return np.empty((0, *self.shape[1:]), self.dtype)[(slice(None), *rest)]
        low = min(indices[0], indices[-1])
        part = self.frames.map(low, max(indices[0], indices[-1]) + 1)
        return part[(slice(None, None, indices.step), *rest)]


@dataclasses.dataclass(frozen=True)
class _UnopenedFrames:
    """Frames of a copy, whose files are opened when they are read."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    open_again: Callable[..., Frames]
    arguments: tuple[Any, ...]

    def map(self, start: int, stop: int) -> npt.NDArray[Any]:
        """Return the frames from `start` to `stop`, as a view of the file if possible.

        Raises
        ------
        OSError, ValueError
            When a file cannot be opened, or has changed.
        """
        return self._opened().map(start, stop)

    def _opened(self) -> Frames:
        """Return the frames of this name that the process has opened, or open them."""
        with _OPENING:  # so that the threads of a worker open each file once
            frames = _COPIES.pop(self.name, None) or self.open_again(*self.arguments)
            _COPIES[self.name] = frames
            for old in list(_COPIES)[:-_KEPT]:
                del _COPIES[old]
        return frames


_COPIES: dict[str, Frames] = {}
"""The frames of the copies that this process used last."""

_OPENING = threading.Lock()


def _name(frames: Frames) -> str | None:
    """Return a name for the lazy array: the same one for the same files, if they are known."""
    from dask.base import tokenize

    origin = frames.origin
    if not isinstance(origin, functools.partial):
        return None
    selections = [repr(key) for key in frames.selections]
    token = tokenize(origin.args, sorted(origin.keywords.items(), key=str), selections)
    return f"bits-{token}"
