"""Bytes that arrive: the end of a growing file, and standard input."""

import os
import threading
from pathlib import Path
from typing import Protocol

POLL_SECONDS = 0.01
"""Time between two looks at a file or folder."""


class Tail(Protocol):
    """Bytes that arrive."""

    def read(self, buffer: memoryview) -> int:
        """Read into a buffer, and return the number of bytes: 0 if there are none yet.

        Raises
        ------
        EOFError
            When no more bytes will arrive.
        OSError
            When the bytes cannot be read any longer.
        """

    def unread(self, data: bytes) -> None:
        """Put back the bytes that were read last, so that they are read again."""

    def skip(self, keep: int, unit: int) -> int:
        """Skip whole units of bytes, and return their number, so that at most `keep` bytes wait."""

    def close(self) -> None:
        """Close it."""


class FileTail:
    """The bytes of a growing file from a position on.

    Parameters
    ----------
    path : path
    stop : threading.Event
        An event that ends waiting.
    """

    def __init__(self, path: Path, stop: threading.Event) -> None:
        self._path, self._stop = path, stop
        self._file = path.open("rb", buffering=0)
        self._position = 0

    @property
    def size(self) -> int:
        """Present size of the file in bytes.

        Raises
        ------
        OSError
            When the file is shorter than before.
        """
        size = os.fstat(self._file.fileno()).st_size
        if size < self._position:
            raise OSError(f"{self._path}: the file became shorter than the bytes that were read")
        return size

    def read(self, buffer: memoryview) -> int:
        """Read into a buffer, and return the number of bytes.

        Raises
        ------
        OSError
            When the file became shorter, or its path no longer leads to it and no bytes wait.
        """
        if self._position >= self.size:
            self._check_path()
            self._stop.wait(POLL_SECONDS)
            return 0
        number = self._file.readinto(buffer) or 0
        self._position += number
        return number

    def _check_path(self) -> None:
        """Raise OSError if the path leads to no file or to another one."""
        try:
            is_same = os.path.samestat(self._path.stat(), os.fstat(self._file.fileno()))
        except FileNotFoundError:
            raise FileNotFoundError(
                f"{self._path}: the file is gone; open the file that the camera writes now"
            ) from None
        if not is_same:
            raise OSError(
                f"{self._path}: another file has replaced it; open it again to follow that one"
            )

    def unread(self, data: bytes) -> None:
        """Read the last bytes again."""
        self.seek(self._position - len(data))

    def skip(self, keep: int, unit: int) -> int:
        """Skip whole units of bytes that wait, until at most `keep` bytes wait."""
        units = max(0, self.size - self._position - keep) // unit
        self.seek(self._position + units * unit)
        return units

    def seek(self, position: int) -> None:
        """Read from a position on."""
        self._file.seek(position)
        self._position = position

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class PipeTail:
    """The bytes of a pipe, such as standard input.

    Reading waits for bytes. So the thread that reads is a daemon thread.
    """

    def __init__(self, descriptor: int) -> None:
        self._file = os.fdopen(os.dup(descriptor), "rb", buffering=0)
        self._unread = b""

    def read(self, buffer: memoryview) -> int:
        """Read into a buffer, and return the number of bytes."""
        if self._unread:
            size = min(len(buffer), len(self._unread))
            buffer[:size], self._unread = self._unread[:size], self._unread[size:]
            return size
        number = self._file.readinto(buffer)
        if number == 0:
            raise EOFError
        return number or 0

    def unread(self, data: bytes) -> None:
        """Keep the last bytes, which are read again first."""
        self._unread = data + self._unread

    def skip(self, keep: int, unit: int) -> int:
        """Return 0: a pipe holds only a few bytes, and its writer waits."""
        return 0

    def close(self) -> None:
        """Close this copy of the pipe."""
        self._file.close()
