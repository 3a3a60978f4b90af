"""Files for libraries to write to, which report every failed write."""

import contextlib
import errno
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any


@contextlib.contextmanager
def open_output(path: Path, *, postpone_errors: bool = False) -> Iterator["OutputFile"]:
    """Yield a new file for a library that writes to a file object.

    Parameters
    ----------
    path : path
        The file, which is replaced if it exists.
    postpone_errors : bool
        Whether a failed write raises its error only at the end of the block, or in
        :meth:`OutputFile.check`. Libraries that crash when a write fails need this.

    Raises
    ------
    OSError
        When a write failed, even if the library ignored it. The error names the file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "note"
    >>> with open_output(path) as file:
    ...     _ = file.write(b"all of it")
    >>> path.read_bytes()
    b'all of it'
    """
    raw = _RawOutput(path, postpone_errors)
    try:
        with OutputFile(raw) as file:
            yield file
    except Exception:
        raw.check()
        raise
    raw.check()


class OutputFile(io.BufferedRandom):
    """A file that does not reveal its descriptor.

    With the descriptor, C code in libraries would write to the file directly. Some libraries then
    lose the reason of a failed write, and some ignore that only a part was written.
    """

    raw: "_RawOutput"

    def check(self) -> None:
        """Raise the error of the first write that failed, if one did."""
        self.raw.check()

    def readinto(self, buffer: Any) -> int:
        """Return the number of bytes read into a buffer. The rest of the buffer becomes zeros."""
        size = super().readinto(buffer)
        # HDF5 would take the old content of the buffer for data.
        view = memoryview(buffer).cast("B")
        view[size:] = bytes(len(view) - size)
        return size


def described_error(text: str, path: Path) -> OSError:
    """Return an OSError for a library or program that states the reason of a failure only as text.

    If the text contains no message of the operating system, the error has its last line.

    Examples
    --------
    >>> described_error("cannot write pixels: No space left on device.", Path("a.exr"))
    OSError(28, 'No space left on device')
    """
    for number in errno.errorcode:
        if os.strerror(number) in text:
            return OSError(number, os.strerror(number), str(path))
    return OSError(errno.EIO, text.strip().splitlines()[-1], str(path))


class _RawOutput(io.FileIO):
    def __init__(self, path: Path, postpone_errors: bool) -> None:
        super().__init__(path, "w+")
        self._path, self._postpone_errors = path, postpone_errors
        self._failure: OSError | None = None

    def fileno(self) -> int:
        raise io.UnsupportedOperation("the descriptor of an output file is hidden")

    def write(self, data: Any) -> int:
        size = memoryview(data).nbytes
        if self._failure is None:
            try:
                return super().write(data) or 0
            except OSError as error:
                self._failure = OSError(error.errno, error.strerror, str(self._path))
        if not self._postpone_errors:
            raise self._failure
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self._failure = self._failure or OSError(error.errno, error.strerror, str(self._path))
            if not self._postpone_errors:
                raise self._failure from error
            return size or 0

    def check(self) -> None:
        if self._failure is not None:
            raise self._failure
