"""NumPy arrays in `.npy` files from untrusted sources.

Only complete arrays of numbers are read. Pickled objects are never loaded. Memory is allocated only
for arrays that the file can fill, whatever its header claims.
"""

import lzma
import os
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt
from isal.igzip_lib import IsalError

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


def check_header(file: IO[bytes]) -> None:
    """Raise ValueError when a file has no `.npy` signature, or claims too long a header.

    NumPy allocates memory for the length that the header claims before it reads the header.
    """
    start = file.read(12)
    file.seek(0)
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
        When the stream has another signature, or a version other than 1 and 2.
    """
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    check_header(file)
    version = np.lib.format.read_magic(file)
    if version not in readers:
        raise ValueError(f"expected version 1 or 2 of the .npy format, got {version}")
    return readers[version](file)


def objects_error(name: str) -> ValueError:
    """Return the error for a file that holds pickled Python objects."""
    return ValueError(
        f"{name}: holds Python objects, which can run code and are never read; "
        "save an array of numbers instead"
    )


def read_npy(path: str | os.PathLike[str]) -> npt.NDArray[Any]:
    """Return the array of a `.npy` file as a read-only memory map.

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
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"{path}: expected a .npy file, got a folder")
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with path.open("rb") as file:
            check_header(file)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    try:
        return np.lib.format.open_memmap(path, mode="r")
    except ValueError as error:
        if "Python objects" in str(error):
            raise objects_error(str(path)) from error
        raise ValueError(
            f"{path}: expected a complete .npy file, but its size does not fit its header "
            f"or the header is damaged ({error})"
        ) from error
    except HEADER_ERRORS as error:
        raise ValueError(f"{path}: the header of the .npy file is damaged ({error})") from error
