"""Arrays in gzip streams and zip archives, read from front to back in little memory."""

import contextlib
import gzip
import math
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt

from jotlight.formats.arrays import (
    ARCHIVE_ERRORS,
    HEADER_ERRORS,
    objects_error,
    read_header,
    read_npz,
    select_npz_array,
)
from jotlight.formats.limits import check_claimed_size
from jotlight.output_files import open_output
from jotlight.sensing.frames import Frames, read_in_chunks

_CHUNK_BYTES = 1 << 20
"""Number of bytes that are decompressed at once."""


@contextlib.contextmanager
def naming_file(name: str) -> Iterator[None]:
    """Raise a ValueError that names the file for every error of decompression."""
    try:
        yield
    except FileNotFoundError:
        raise
    except (*HEADER_ERRORS, *ARCHIVE_ERRORS) as error:
        raise ValueError(f"{name}: damaged or truncated ({error})") from error


class Stream:
    """Random access to a compressed stream. Moving backward reopens the stream.

    Parameters
    ----------
    reopen : callable
        A function that returns the stream at its beginning.

    Examples
    --------
    >>> import io
    >>> stream = Stream(lambda: io.BytesIO(b"abcdef"))
    >>> bytes(stream.read(4, 10)), bytes(stream.read(1, 2))
    (b'ef', b'bc')
    """

    def __init__(self, reopen: Callable[[], IO[bytes]]) -> None:
        self._reopen = reopen
        self._file: IO[bytes] | None = None
        self._position = 0

    def read(self, position: int, size: int) -> bytearray:
        """Return `size` bytes from `position` on, or fewer if the stream ends."""
        if self._file is None or position < self._position:
            self.close()
            self._file, self._position = self._reopen(), 0
        while self._position < position:
            skipped = len(self._file.read(min(_CHUNK_BYTES, position - self._position)))
            if skipped == 0:
                return bytearray()
            self._position += skipped
        data = bytearray()
        while len(data) < size and (chunk := self._file.read(min(_CHUNK_BYTES, size - len(data)))):
            data += chunk
        self._position += len(data)
        return data

    def close(self) -> None:
        """Close the file. The next read reopens it."""
        if self._file is not None:
            self._file.close()
        self._file = None

    def __del__(self) -> None:
        self.close()


def stream_npy(reopen: Callable[[], IO[bytes]], name: str, file_bytes: int) -> Frames:
    """Return the array of a compressed `.npy` stream as frames.

    Parameters
    ----------
    reopen : callable
        A function that returns the decompressed stream at its beginning.
    name : str
        The file, for messages.
    file_bytes : int
        Size of the compressed file.

    Raises
    ------
    ValueError
        When the stream is not a `.npy` file, is damaged, holds Python objects, or is in Fortran
        order.
    """
    with naming_file(name), reopen() as file:
        shape, fortran_order, dtype = read_header(file)
        header_bytes = file.tell()
    if dtype.hasobject:
        raise objects_error(name)
    if fortran_order and len(shape) > 1:
        raise ValueError(f"{name}: expected an array in C order, got Fortran order")
    if len(shape) == 0:
        raise ValueError(f"{name}: expected an array, got a single number")
    frame_bytes = math.prod(shape[1:]) * dtype.itemsize
    check_claimed_size(name, frame_bytes * shape[0], file_bytes)
    stream = Stream(reopen)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        size = (stop - start) * frame_bytes
        with naming_file(name):
            data = stream.read(header_bytes + start * frame_bytes, size)
        if len(data) != size:
            raise ValueError(f"{name}: ends before the {shape[0]} frames that its header claims")
        return np.frombuffer(data, dtype).reshape(stop - start, *shape[1:])

    return Frames(shape, read, dtype)


def open_gzip(path: Path) -> IO[bytes]:
    """Return the decompressed stream of a gzip file, at its beginning."""
    return cast(IO[bytes], gzip.open(path))


def stream_npy_gz(path: Path) -> Frames:
    """Return the array of a `.npy.gz` file as frames."""
    return stream_npy(lambda: open_gzip(path), str(path), path.stat().st_size)


def stream_npz(path: Path, key: str | None) -> npt.NDArray[Any] | Frames:
    """Return one array of a `.npz` archive as frames. `key` is optional for an only array.

    An array in Fortran order cannot be streamed, so it is read into memory.
    """
    key = select_npz_array(path, key)

    def reopen() -> IO[bytes]:
        return zipfile.ZipFile(path).open(f"{key}.npy")

    try:
        return stream_npy(reopen, f"{path}: {key}", path.stat().st_size)
    except ValueError as error:
        if "Fortran" not in str(error):
            raise
        return read_npz(path, key)


def write_npy_gz(path: Path, array: npt.NDArray[np.generic] | Frames) -> None:
    """Write an array as a `.npy.gz` file, some frames at a time."""
    header = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
    # The gzip header has no name and no time, so equal data yield equal files.
    with open_output(path) as raw, gzip.GzipFile("", "wb", 6, raw, mtime=0) as file:
        np.lib.format.write_array_header_1_0(file, header)
        for _, part in read_in_chunks(array, _CHUNK_BYTES):
            file.write(np.ascontiguousarray(part).tobytes())
