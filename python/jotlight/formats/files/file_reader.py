"""Reading of any part of a file, with an error if the file has changed since it was opened."""

import contextlib
import mmap
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jotlight.array_types import Packed
from jotlight.errors import ChangedFileError
from jotlight.formats.files.remote_files import remote_file

_MIN_LARGE_PAGES = 1 << 22
"""Minimum number of bytes that are mapped with large pages. Linux reads as many at a time."""


class FileReader:
    """The bytes of a file, which are read when they are needed.

    Except for lazy arrays and runs, the file is not mapped into memory, because the operating
    system kills a process that uses the map of a file that has become shorter. It is not kept open
    either, because a folder may have more files than the system lets a process open at once.

    Parameters
    ----------
    path : path

    Raises
    ------
    OSError
        When there is no such file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "frames.bin"
    >>> _ = path.write_bytes(bytes(range(10)))
    >>> file = FileReader(path)
    >>> file.size, file.read(3, 2).tolist()
    (10, [3, 4])
    """

    # A folder may have millions of files.
    __slots__ = ("_version", "path", "size")

    def __init__(self, path: Path) -> None:
        self.path = path
        status = path.stat()
        self.size = status.st_size
        """Size of the file in bytes."""
        self._version = _version(status)

    def read(self, position: int, size: int) -> Packed:
        """Return `size` bytes from `position` on.

        Raises
        ------
        OSError
            When the file has changed since it was opened, or is too short.
        """
        self._check_size(position + size)  # before memory is allocated
        if (remote := remote_file(self.path)) is not None:
            return np.frombuffer(remote.read(position, position + size), np.uint8)
        data = np.empty(size, np.uint8)
        with self.path.open("rb", buffering=0) as file:
            file.seek(position)
            left = data.data
            while left and (number := file.readinto(left)):
                left = left[number:]
            # This check comes last, so it also finds changes during the reading.
            self._check(os.fstat(file.fileno()), complete=not left)
        return data

    def map(self, position: int, size: int) -> Packed:
        """Return a read-only view of `size` bytes from `position` on, which is not copied.

        Raises
        ------
        OSError
            When the file has changed since it was opened, or is too short.
        """
        self._check_size(position + size)
        if size == 0 or remote_file(self.path) is not None:
            return self.read(position, size)
        self.check_unchanged()
        data = np.memmap(self.path, np.uint8, "r", position, (size,))
        if size >= _MIN_LARGE_PAGES and hasattr(mmap, "MADV_HUGEPAGE"):
            # Linux then reads the file in large pages, and a page of 2 MiB needs one page fault.
            file_map: Any = data.base
            with contextlib.suppress(OSError):  # this system has no large pages
                file_map.madvise(mmap.MADV_HUGEPAGE)
        self.check_unchanged()
        return data.view(np.ndarray)

    def _check_size(self, end: int) -> None:
        if end > self.size:
            raise OSError(f"{self.path}: expected {end} bytes, got {self.size}; it is truncated")

    def check_unchanged(self) -> None:
        """Raise OSError when the file has changed since it was opened, or is missing."""
        self._check(self.path.stat())

    @contextlib.contextmanager
    def expect_unchanged(self) -> Iterator[None]:
        """Raise OSError when the file has changed before or while a library reads it.

        A change during the reading may also cause an error of the library, which it then replaces.
        """
        self.check_unchanged()
        try:
            yield
        except Exception:
            self.check_unchanged()
            raise
        self.check_unchanged()

    def _check(self, status: os.stat_result, *, complete: bool = True) -> None:
        if not complete or _version(status) != self._version:
            raise ChangedFileError.of_file(self.path)


def _version(status: os.stat_result) -> tuple[int, ...]:
    """Return numbers that change if a file is replaced, resized, or written."""
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
