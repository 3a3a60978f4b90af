"""NumPy arrays in `.npy` files from untrusted sources.

Only complete arrays of numbers are read. Pickled objects are never loaded. Memory is allocated only
for arrays that the file can fill, whatever its header claims.
"""

import lzma
import math
import os
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt
from isal.igzip_lib import IsalError

from jotlight.errors import counted, warn
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.remote_files import open_binary
from jotlight.sensing.bits.frames import Frames, read_in_chunks

HEADER_ERRORS = (
    ValueError,
    EOFError,
    OverflowError,
    TypeError,
    SyntaxError,
    RecursionError,
    TokenError,
)
"""Exceptions that NumPy raises when the header of a `.npy` file is damaged."""

# RuntimeError: the member is encrypted, or Python does not support its compression.
ARCHIVE_ERRORS = (
    OSError,
    RuntimeError,
    MemoryError,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    cast(type[Exception], IsalError),
)
"""Exceptions that Python raises when a zip archive or a gzip stream is damaged."""

_MAX_HEADER_BYTES = 1 << 16
"""Maximum length in bytes of a header."""

_WRITTEN_BYTES = 1 << 24
"""Number of bytes that are written at once. Simulated frames cost additional time for each part."""

_MAX_SIZE = 1 << 63
"""NumPy's limit on each dimension. The header of an array without elements could claim more."""


def reason(error: Exception) -> str:
    """Return the message of an exception. zipfile raises EOFError without one."""
    if "end-of-stream marker" in str(error):  # igzip means both cases
        return "it ends too early, or has other bytes after its end"
    return str(error) or ("it ends too early" if isinstance(error, EOFError) else repr(error))


def check_header(file: IO[bytes]) -> None:
    """Raise ValueError when a file has no `.npy` signature, or claims too long a header.

    NumPy allocates memory for the length that the header claims before it reads the header.
    """
    begin = file.tell()
    start = file.read(12)
    file.seek(begin)
    if start[:6] != np.lib.format.MAGIC_PREFIX:
        raise ValueError("expected a .npy file, but it does not begin like one")
    if start[6:7] > b"\x01" and int.from_bytes(start[8:12], "little") > _MAX_HEADER_BYTES:
        raise ValueError("the header of the .npy file is damaged")


def read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return the shape, whether the order is Fortran's, and the dtype of a `.npy` stream.

    After the call, the stream is at the first byte of the data.

    Raises
    ------
    ValueError
        When the stream has another signature, a version other than 1, 2, and 3, or elements that
        are arrays themselves.
    """
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
        # Only the encoding of field names differs from version 2, and arrays of numbers have none.
        (3, 0): np.lib.format.read_array_header_2_0,
    }
    check_header(file)
    version = np.lib.format.read_magic(file)
    if version not in readers:
        raise ValueError(f"expected version 1, 2, or 3 of the .npy format, got {version}")
    try:
        shape, fortran_order, dtype = readers[version](file)
    except ValueError as error:
        if "malformed node" in str(error):  # followed by an object of Python
            raise ValueError("it is no dictionary of constants") from error
        raise
    if dtype.shape:
        raise ValueError(f"expected an array of numbers, got elements of {dtype}")
    return shape, fortran_order, dtype


def objects_error(name: str) -> ValueError:
    """Return the error for a file that holds pickled Python objects."""
    return ValueError(
        f"{name}: holds Python objects, which can run code and are never read; "
        "save an array of numbers instead"
    )


def read_npy(path: str | os.PathLike[str]) -> npt.NDArray[Any]:
    """Return the array of a `.npy` file, read completely.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When the file is not a `.npy` file, is truncated, or holds Python objects.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "counts.npy"
    >>> np.save(path, np.arange(3))
    >>> read_npy(path).tolist()
    [0, 1, 2]
    """
    return np.asarray(open_npy_array(path))


def open_npy_array(
    path: str | os.PathLike[str], begin: int = 0, end: int | None = None
) -> npt.NDArray[Any] | Frames:
    """Return the array of a `.npy` file as frames, which are read when they are needed.

    `begin` and `end` are the positions of the `.npy` file in a file that contains it. An array
    without dimensions is read completely, and so is an array in Fortran order, because its frames
    are not contiguous. Warns about bytes after the array, which are not read.

    Raises
    ------
    OSError, ValueError
        As for :func:`read_npy`. If the file has changed, reading the frames raises OSError.
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"{path}: expected a .npy file, got a folder")
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    reader = FileReader(path)
    try:
        with open_binary(path) as file:
            file.seek(begin)
            check_header(file)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    try:
        with open_binary(path) as file:
            file.seek(begin)
            shape, fortran_order, dtype = read_header(file)
            start = file.tell()
    except HEADER_ERRORS as error:
        raise ValueError(f"{path}: the header of the .npy file is damaged ({error})") from error
    if dtype.hasobject:
        raise objects_error(str(path))
    possible = all(0 <= size < _MAX_SIZE for size in shape)
    available = (reader.size if end is None else min(end, reader.size)) - start
    if not possible or math.prod(shape) * dtype.itemsize > available:
        raise ValueError(
            f"{path}: expected a complete .npy file, but its size does not fit its header, or the "
            f"header is damaged (claims {dtype} of shape {shape}, has {reader.size} bytes)"
        )
    if left := available - math.prod(shape) * dtype.itemsize:
        warn(
            f"{path}: has {counted(left, 'byte')} beyond the array of shape {shape} that the "
            "header states, which jotlight does not read; the header may state too few frames, or "
            "the file holds several arrays"
        )
    if fortran_order or not shape:
        data = reader.read(start, math.prod(shape) * dtype.itemsize)
        return np.ndarray(shape, dtype, data, order="F")
    frame_bytes = math.prod(shape[1:]) * dtype.itemsize

    def read(first: int, stop: int) -> npt.NDArray[Any]:
        data = reader.read(start + first * frame_bytes, (stop - first) * frame_bytes)
        return np.ndarray((stop - first, *shape[1:]), dtype, data)

    def mapped(first: int, stop: int) -> npt.NDArray[Any]:
        data = reader.map(start + first * frame_bytes, (stop - first) * frame_bytes)
        return np.ndarray((stop - first, *shape[1:]), dtype, data)

    return Frames(shape, read, dtype, mapped=mapped)


def write_npy(
    file: IO[bytes], array: npt.NDArray[Any] | Frames, shape: tuple[int, ...] | None = None
) -> None:
    """Write an array in the `.npy` format, some frames at a time.

    Parameters
    ----------
    file : binary file
    array : ndarray or Frames
    shape : tuple of int, optional
        The shape that the header states, with the same number of elements. Default: that of the
        array.
    """
    header = {"descr": array.dtype.str, "fortran_order": False, "shape": shape or array.shape}
    np.lib.format.write_array_header_1_0(file, header)
    for _, part in read_in_chunks(array, _WRITTEN_BYTES):
        file.write(np.ascontiguousarray(part).data)
        del part  # before the next part needs memory
