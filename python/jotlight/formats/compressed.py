"""Arrays of NumPy that are compressed, read from front to back in little memory."""

import contextlib
import gzip
import math
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt

from jotlight.formats.arrays import BAD_ARCHIVE, DAMAGED, check_header, list_npz_arrays, read_npz
from jotlight.formats.limits import check_claimed_size
from jotlight.sensing.frames import Frames

_SKIP = 1 << 20


@contextlib.contextmanager
def said(name: str) -> Iterator[None]:
    """Say of which file it is that reading failed."""
    try:
        yield
    except FileNotFoundError:
        raise
    except (*DAMAGED, *BAD_ARCHIVE) as error:
        raise ValueError(f"{name}: damaged or truncated ({error})") from error


class Stream:
    """Bytes at any place of a stream; going back begins anew."""

    def __init__(self, begin: Callable[[], IO[bytes]]) -> None:
        self._begin = begin
        self._file: IO[bytes] | None = None
        self._place = 0

    def read(self, place: int, size: int) -> bytearray:
        """Bytes from a place on; fewer where the stream ends."""
        if self._file is None or place < self._place:
            self.close()
            self._file, self._place = self._begin(), 0
        while self._place < place:
            skipped = len(self._file.read(min(_SKIP, place - self._place)))
            if skipped == 0:
                return bytearray()
            self._place += skipped
        data = bytearray()
        while len(data) < size and (piece := self._file.read(min(_SKIP, size - len(data)))):
            data += piece
        self._place += len(data)
        return data

    def close(self) -> None:
        """Let go of the file."""
        if self._file is not None:
            self._file.close()
        self._file = None

    def __del__(self) -> None:
        self.close()


def stream_npy(begin: Callable[[], IO[bytes]], name: str, there: int) -> Frames:
    """Frames of a `.npy` in a stream that is compressed to `there` bytes.

    Raises
    ------
    ValueError
        When it is no such array or damaged, holds Python objects, or is in Fortran's order.
    """
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    with said(name), begin() as file:
        check_header(file)
        version = np.lib.format.read_magic(file)
        if version not in readers:
            raise ValueError(f"expected version 1 or 2 of the .npy format, got {version}")
        shape, fortran, dtype = readers[version](file)
        header = file.tell()
    if dtype.hasobject:
        raise ValueError(
            f"{name}: holds Python objects, which can run code and are never read; "
            "save an array of numbers instead"
        )
    if fortran and len(shape) > 1:
        raise ValueError(f"{name}: expected an array in C order, got one in Fortran's order")
    if len(shape) == 0:
        raise ValueError(f"{name}: expected an array, got a single number")
    each = math.prod(shape[1:]) * dtype.itemsize
    check_claimed_size(name, each * shape[0], there)
    stream = Stream(begin)

    def read(first: int, last: int) -> npt.NDArray[Any]:
        with said(name):
            data = stream.read(header + first * each, (last - first) * each)
        if len(data) != (last - first) * each:
            raise ValueError(f"{name}: ends before the {shape[0]} frames that its header tells of")
        return np.frombuffer(data, dtype).reshape(last - first, *shape[1:])

    return Frames(shape, read, dtype)


def open_gzip(path: Path) -> IO[bytes]:
    """What a compressed file holds, from its beginning."""
    return cast(IO[bytes], gzip.open(path))


def open_npy_gz(path: Path) -> Frames:
    """Frames of a `.npy.gz`."""
    return stream_npy(lambda: open_gzip(path), str(path), path.stat().st_size)


def open_npz(path: Path, key: str | None) -> npt.NDArray[Any] | Frames:
    """Frames of an array in a `.npz`, by name where it holds several."""
    names = list_npz_arrays(path)
    key = names[0] if key is None and len(names) == 1 else key
    if key not in names:
        return read_npz(path, key)  # which says what is wrong
    member = f"{key}.npy"

    def begin() -> IO[bytes]:
        return zipfile.ZipFile(path).open(member)

    try:
        return stream_npy(begin, f"{path}: {key}", path.stat().st_size)
    except ValueError as error:
        if "Fortran" not in str(error):
            raise
        return read_npz(path, key)
