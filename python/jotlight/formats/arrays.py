"""Arrays of NumPy in files, `.npy` and `.npz`, by strangers: whole, of numbers, never pickled."""

import lzma
import math
import os
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
import numpy.typing as npt

DAMAGED = (
    ValueError,
    EOFError,
    OverflowError,
    TypeError,
    SyntaxError,
    RecursionError,
    TokenError,
)
"""What reading a damaged header may raise."""

# RuntimeError for what is encrypted or packed in a way that Python lacks.
BAD_ARCHIVE = (
    OSError,
    RuntimeError,
    MemoryError,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
)
"""What reading a damaged archive may raise."""


LABEL = "jotlight.json"
"""The member of our archives that tells what the array is."""

_LONGEST_HEADER = 1 << 16
_LONGEST_LABEL = 1 << 20


def check_header(file: IO[bytes]) -> None:
    """Raise ValueError for what does not begin like a `.npy`, or has a header too long to be one.

    NumPy takes memory for as many bytes as are told before it reads them.
    """
    start = file.read(12)
    file.seek(0)
    if start[:6] != np.lib.format.MAGIC_PREFIX:
        raise ValueError("expected a .npy file, but it does not begin like one")
    if start[6:7] > b"\x01" and int.from_bytes(start[8:12], "little") > _LONGEST_HEADER:
        raise ValueError("the header of the .npy file is damaged")


def read_npy(path: str | os.PathLike[str]) -> npt.NDArray[Any]:
    """Memory-map a `.npy` file of numbers.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When it is no `.npy` file, is truncated, or holds Python objects (which are never read).
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
            raise ValueError(
                f"{path}: holds Python objects, which can run code and are never read; "
                "save an array of numbers instead"
            ) from error
        raise ValueError(
            f"{path}: expected a whole .npy file, but its size does not fit its header "
            f"or the header is damaged ({error})"
        ) from error
    except DAMAGED as error:
        raise ValueError(f"{path}: the header of the .npy file is damaged ({error})") from error


def read_npz(path: str | os.PathLike[str], key: str | None = None) -> npt.NDArray[Any]:
    """Read one array of a `.npz` archive, by name where it holds several.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When it is no such archive, is damaged, holds Python objects, or has no array `key`.
    """
    path = Path(path)
    names = list_npz_arrays(path)
    if key is None and len(names) == 1:
        key = names[0]
    if key not in names:
        told = "" if key is None else f", got {key!r}"
        raise ValueError(f"{path}: expected the name of an array (--key): {', '.join(names)}{told}")
    try:
        with zipfile.ZipFile(path) as archive:
            _check_size(archive, f"{key}.npy")
            # NumPy's own reader of archives hands out the bytes of what is no array.
            with archive.open(f"{key}.npy") as member:
                return np.asarray(np.lib.format.read_array(member, allow_pickle=False))
    except (*DAMAGED, *BAD_ARCHIVE) as error:
        if "Object arrays" in str(error):
            raise ValueError(
                f"{path}: {key} holds Python objects, which can run code and are never read; "
                "save an array of numbers instead"
            ) from error
        raise ValueError(f"{path}: the array {key} is damaged ({error})") from error


def _check_size(archive: zipfile.ZipFile, name: str) -> None:
    """Raise ValueError when a member's header asks for more memory than the member has bytes."""
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    with archive.open(name) as member:
        check_header(member)
        version = np.lib.format.read_magic(member)
        if version not in readers:
            raise ValueError(f"expected version 1 or 2 of the .npy format, got {version}")
        shape, _, dtype = readers[version](member)
    size, there = math.prod(shape) * dtype.itemsize, archive.getinfo(name).file_size
    if not dtype.hasobject and not 0 <= size <= there:
        raise ValueError(f"its header tells of {size} bytes, but there are {there}")


def read_npz_label(path: Path) -> str | None:
    """What an archive of ours tells of its array."""
    try:
        with zipfile.ZipFile(path) as archive, archive.open(LABEL) as member:
            return member.read(_LONGEST_LABEL).decode()
    except (KeyError, *DAMAGED, *BAD_ARCHIVE):
        return None


def list_npz_arrays(path: Path) -> list[str]:
    """The names of the arrays in a `.npz` archive."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.namelist()
    except BAD_ARCHIVE as error:
        raise ValueError(f"{path}: expected a .npz archive ({error})") from error
    names = [name.removesuffix(".npy") for name in members if name.endswith(".npy")]
    if not names:
        raise ValueError(f"{path}: expected a .npz archive of arrays, got none in it")
    return names
