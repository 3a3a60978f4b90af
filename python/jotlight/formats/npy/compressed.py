"""Arrays in compressed streams, read from front to back in little memory."""

import contextlib
import math
import os
import sys
from collections.abc import Callable, Iterator
from io import BufferedIOBase
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt
from isal import igzip

from jotlight.errors import warn
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.limits import check_claimed_size
from jotlight.formats.files.locks import ProcessLock
from jotlight.formats.npy.arrays import (
    ARCHIVE_ERRORS,
    HEADER_ERRORS,
    objects_error,
    read_header,
    reason,
    write_npy,
)
from jotlight.sensing.bits.frames import Frames

_CHUNK_BYTES = 1 << 20
"""Number of bytes that are decompressed at once."""

_MAX_REPEATED, _MAX_REPEATED_BYTES = 2, 1 << 28
"""How often a stream may be decompressed again before a warning, and the number of bytes."""

_LEVEL = 2
"""Compression level, from 0 to 3. Level 3 is slower and does not compress bits better."""


@contextlib.contextmanager
def naming_file(name: str) -> Iterator[None]:
    """Raise a ValueError that names the file for every error of decompression."""
    try:
        yield
    except FileNotFoundError:
        raise
    except (*HEADER_ERRORS, *ARCHIVE_ERRORS) as error:
        if str(error).startswith(name):
            raise
        raise ValueError(f"{name}: damaged or truncated ({reason(error)})") from error


class Stream:
    """Random access to a compressed stream. Moving backward reopens the stream.

    Parameters
    ----------
    name : str
        The file, for a warning if moving backward takes long.
    reopen : callable
        A function that returns the stream at its beginning.
    size : int
        Number of decompressed bytes.
    check_unchanged : callable
        A function that raises OSError when the file has changed since it was opened.

    Examples
    --------
    >>> import io
    >>> stream = Stream("a.npy.gz", lambda: io.BytesIO(b"abcdef"), 6, lambda: None)
    >>> stream.read(4, 2).tobytes(), stream.read(1, 2).tobytes()
    (b'ef', b'bc')
    """

    def __init__(
        self,
        name: str,
        reopen: Callable[[], BufferedIOBase],
        size: int,
        check_unchanged: Callable[[], object],
    ) -> None:
        self._name = name
        self._reopen = reopen
        self._size = size
        self._check_unchanged = check_unchanged
        self._file: BufferedIOBase | None = None
        self._position = 0
        self._repeated = 0
        self._process = os.getpid()
        self._lock = ProcessLock()

    def read(self, position: int, size: int) -> npt.NDArray[np.uint8]:
        """Return `size` bytes from `position` on.

        When the end of the stream is reached, its checksum is compared and the file is closed.

        Raises
        ------
        ValueError
            When the stream is shorter or longer than stated.
        OSError or another one of ARCHIVE_ERRORS
            When the stream is damaged, or its file has changed.
        """
        with self._lock:
            self._forget_file_of_parent()
            if self._file is None or position < self._position:
                self._close()
                self._file, self._position = self._reopen(), 0
                self._repeated += position
            skip_bytes(self._file, position - self._position)
            data = np.empty(size, np.uint8)
            view, done = data.data, 0
            while done < size and (count := self._file.readinto(view[done : done + _CHUNK_BYTES])):
                done += count
            if done < size:
                raise ValueError(f"ends {size - done} bytes too early")
            self._position = position + size
            if self._position == self._size:
                self._close(at_end=True)
        self._check_unchanged()
        self._warn_about_repetition()
        return data

    def _warn_about_repetition(self) -> None:
        """Warn once if reading in another order than that of the stream takes long."""
        if self._repeated > max(_MAX_REPEATED * self._size, _MAX_REPEATED_BYTES):
            self._repeated = -sys.maxsize
            warn(
                f"{self._name}: is decompressed from its beginning for each frame that is read "
                "again, as by windows that overlap, or that follows later ones, as by the chunks "
                'of a lazy array; a copy is read in any order: jotlight.save(bits, "copy.npy") '
                "(`jotlight convert`)"
            )

    def finish(self) -> None:
        """Read the rest of the stream if it is open, compare its checksum, and close the file."""
        with self._lock:
            self._forget_file_of_parent()
            if self._file is not None:
                skip_bytes(self._file, self._size - self._position)
                self._close(at_end=True)

    def _forget_file_of_parent(self) -> None:
        """Forget the file in a fork, because the parent moves the position in it too."""
        if self._process != os.getpid():
            self._file, self._process = None, os.getpid()

    def _close(self, *, at_end: bool = False) -> None:
        """Close the file. The next read reopens it."""
        file, self._file = self._file, None
        if file is not None:
            with file:
                if at_end:
                    check_end(file)

    def __del__(self) -> None:
        self._close()


def skip_bytes(file: BufferedIOBase, size: int) -> None:
    """Read `size` bytes of a stream. Raise ValueError when it is shorter."""
    while size and (chunk := file.read(min(_CHUNK_BYTES, size))):
        size -= len(chunk)
    if size:
        raise ValueError(f"ends {size} bytes too early")


def check_end(file: BufferedIOBase) -> None:
    """Raise ValueError when a stream has more bytes. Reading its end compares its checksum."""
    if file.read(1):
        raise ValueError("more bytes follow than the header of the array states")


def stream_npy(
    reopen: Callable[[], BufferedIOBase], path: Path, name: str, *, verified: bool = False
) -> Frames:
    """Return the array of a compressed `.npy` stream as frames.

    Parameters
    ----------
    reopen : callable
        A function that returns the decompressed stream at its beginning.
    path : path
        The compressed file.
    name : str
        The path, and the array if the file has several, for messages.
    verified : bool
        Whether the compressed file has been compared with a stored checksum. Otherwise the whole
        stream is read once to compare the checksum at its end, before any frame is returned.

    Raises
    ------
    ValueError
        When the stream is not a `.npy` file, is damaged, holds Python objects, or is in Fortran
        order.
    """
    source = FileReader(path)
    with naming_file(name), reopen() as file:
        shape, fortran_order, dtype = read_header(cast(IO[bytes], file))
        header_bytes = file.tell()
        if dtype.hasobject:
            raise objects_error(name)
        if fortran_order and len(shape) > 1:
            raise ValueError(f"{name}: expected an array in C order, got Fortran order")
        if len(shape) == 0 or min(shape) < 0:
            raise ValueError(f"{name}: expected an array, got shape {shape}")
        frame_bytes = math.prod(shape[1:]) * dtype.itemsize
        size = frame_bytes * shape[0]
        image_bytes = size if len(shape) == 2 else frame_bytes
        check_claimed_size(name, size, source.size, frame_bytes=image_bytes)
        if not verified:
            skip_bytes(file, size)
            check_end(file)
    stream = Stream(name, reopen, header_bytes + size, source.check_unchanged)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        with naming_file(name):
            data = stream.read(header_bytes + start * frame_bytes, (stop - start) * frame_bytes)
        return data.view(dtype).reshape(stop - start, *shape[1:])

    return Frames(shape, read, dtype)


def open_gzip(path: Path) -> BufferedIOBase:
    """Return the decompressed stream of a gzip file, at its beginning."""
    return igzip.IGzipFile(path, "rb")


def measure_gzip(path: Path, end_bytes: int = 0) -> tuple[int, bytes]:
    """Return the decompressed size of a gzip file and its last bytes, and compare its checksum.

    Raises
    ------
    OSError or another one of ARCHIVE_ERRORS
        When the file is damaged.
    """
    size, end = 0, b""
    with open_gzip(path) as file:
        while chunk := file.read(_CHUNK_BYTES):
            size += len(chunk)
            end = (end + chunk)[-end_bytes:] if end_bytes else b""
    return size, end


def stream_npy_gz(path: Path, *, verified: bool = False) -> Frames:
    """Return the array of a `.npy.gz` file as frames. See :func:`stream_npy` for `verified`."""
    return stream_npy(lambda: open_gzip(path), path, str(path), verified=verified)


def write_npy_gz(file: IO[bytes], array: npt.NDArray[np.generic] | Frames) -> None:
    """Write an array as a `.npy.gz` file, some frames at a time."""
    # The gzip header has no name and no time, so equal data yield equal files.
    with igzip.IGzipFile("", "wb", _LEVEL, file, mtime=0) as compressed:
        write_npy(cast(IO[bytes], compressed), array)
