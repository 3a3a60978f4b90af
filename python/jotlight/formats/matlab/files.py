"""Frames in one `.mat` file: versions 5 to 7, which SciPy reads, and 7.3, which is HDF5."""

import hashlib
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from jotlight.errors import SeveralArraysError
from jotlight.formats.files.checksums import check_file, differs_error
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.limits import check_claimed_size
from jotlight.formats.files.locks import ProcessLock
from jotlight.formats.files.magic import has_type
from jotlight.formats.files.remote_files import open_binary, raise_failure, remote_file
from jotlight.formats.frames.labeled import several_arrays_error
from jotlight.formats.hdf5.captures import Library, list_data_sets
from jotlight.formats.matlab.sizes import check_sizes, check_streams, extract_variable
from jotlight.sensing.bits.frames import Frames

VARIABLE = "OUTPUT"
"""Name of the variable that the software of cameras and jotlight write."""

_NUMERIC_CLASSES = {
    *("logical", "uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64"),
    *("single", "double"),
}
"""Classes of variables that can contain frames."""


def open_mat(path: Path, key: str | None, library: Library, checksum: str | None) -> Frames:
    """Return the frames of one file, (T, H, W).

    Parameters
    ----------
    path : path
        A `.mat` file.
    key : str, optional
        Name of the variable.
    library : Library
        The HDF5 library, for version 7.3.
    checksum : str, optional
        SHA-256 of the file, which is checked when frames are read.
    """
    with open_binary(path) as file:
        start = file.read(128)
    if b"MATLAB 7.3" in start or has_type(path, "hdf5"):
        if checksum is not None:
            raise ValueError(f"{path}: expected the version that jotlight writes, got 7.3")
        return _open_version_7_3(path, key, library)
    return _open_version_5(path, key, checksum)


def _open_version_5(path: Path, key: str | None, checksum: str | None) -> Frames:
    """Return the frames of a file up to version 7, which SciPy can read only as a whole."""
    from scipy.io import loadmat, whosmat

    file = FileReader(path)
    try:
        sizes = check_sizes(path)
        with open_binary(path) as opened:
            listed = list(zip(whosmat(opened), sizes, strict=True))
    except Exception as error:  # SciPy may raise any exception for a damaged file
        raise_failure([path])
        raise ValueError(f"{path}: expected a MATLAB file ({error})") from error
    numeric: dict[str, tuple[tuple[int, ...], int]] = {}
    for (name, shape, kind), size in listed:
        if kind in _NUMERIC_CLASSES:
            numeric.setdefault(name, (shape, size))  # SciPy, too, reads the first of equal names
    name = _select_variable(numeric, key)
    if name is None:
        raise SeveralArraysError.of_file(path, list(numeric), key, "variable")
    number = next(index for index, ((each, *_), _) in enumerate(listed) if each == name)
    shape, size = tuple(map(int, numeric[name][0])), numeric[name][1]
    shape = (*shape, 1) if len(shape) == 2 else shape
    if len(shape) != 3 or min(shape) < 0:
        raise ValueError(f"{path}: expected {name} of shape (H, W, T), got {shape}")
    frame_bytes = size // max(1, shape[2])
    check_claimed_size(str(path), size, file.size, frame_bytes=frame_bytes, whole=True)
    if math.prod(shape) > size:
        raise ValueError(f"{path}: {name} has shape {shape}, but only {size} bytes; it is damaged")
    # The cache holds the array until the last frame is read, so reading in order loads it once.
    cache: list[npt.NDArray[Any]] = []
    lock = ProcessLock()

    def load() -> npt.NDArray[Any]:
        if checksum is not None and remote_file(path) is None:
            check_file(path, checksum)
        try:
            with _opened(path, number, checksum) as opened:
                check_streams(opened)
                opened.seek(0)
                array = loadmat(opened, variable_names=[name], chars_as_strings=False)[name]
        except Exception as error:
            raise_failure([path])
            raise ValueError(f"{path}: {name} is damaged ({error})") from error
        if not isinstance(array, np.ndarray) or array.size != math.prod(shape):
            raise ValueError(f"{path}: {name} is damaged")
        return np.moveaxis(array.reshape(shape), 2, 0)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        with lock:
            with file.expect_unchanged():
                array = cache[0] if cache else load()
            cache[:] = [array] if stop < shape[2] else []
        # Only the part is converted, because int64 takes eight times the memory of bits.
        return _as_integers(path, array[start:stop])

    return Frames((shape[2], *shape[:2]), read, np.int64)


def _opened(path: Path, number: int, checksum: str | None) -> BinaryIO:
    """Return a file that contains a variable. At a URL, nothing is read twice."""
    if remote_file(path) is None:
        return path.open("rb")
    with open_binary(path) as file:
        if checksum is None:
            return io.BytesIO(extract_variable(file, number))
        content = file.read()
    if hashlib.sha256(content).hexdigest() != checksum:
        raise differs_error(path)
    return io.BytesIO(content)


def _open_version_7_3(path: Path, key: str | None, library: Library) -> Frames:
    """Return the frames of a file of version 7.3, which is HDF5 with dimensions reversed."""
    data_sets = list_data_sets(path, library)
    name = _select_variable(data_sets, key)
    if name is None:
        raise several_arrays_error(path, data_sets, key, "variable")
    data = data_sets[name].open().frames
    shape = data.shape if len(data.shape) == 3 else (1, *data.shape)
    if len(shape) != 3:
        raise ValueError(f"{path}: expected {name} of shape (H, W, T), got {data.shape[::-1]}")

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        part = data.read(start, stop) if len(data.shape) == 3 else np.asarray(data)[None]
        return _as_integers(path, part.swapaxes(1, 2))

    return Frames((shape[0], shape[2], shape[1]), read, np.int64)


def _select_variable(variables: Mapping[str, object], key: str | None) -> str | None:
    """Return the name of the chosen variable, or None if there is none or no clear choice."""
    if key is None and VARIABLE in variables:
        return VARIABLE
    if key is None and len(variables) == 1:
        return next(iter(variables))
    return key if key in variables else None


def _as_integers(path: Path, part: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Return whole numbers of any type as int64. MATLAB stores them as floats by default."""
    with np.errstate(invalid="ignore"):
        integers = part.astype(np.int64)
    if part.dtype.kind not in "biuf" or (part.dtype.kind == "f" and (integers != part).any()):
        raise ValueError(f"{path}: expected bits or counts in whole numbers, got {part.dtype}")
    return integers
