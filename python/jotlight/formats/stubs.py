"""Stubs: sparse local files that stand for files at URLs.

A stub has the size of its file, and contains only its first and last bytes.
:class:`jotlight.formats.file_reader.FileReader` and the store of zarr read all other bytes from the
URL, in ranges.
"""

from pathlib import Path
from typing import Any

from jotlight.formats.file_systems import explained

_remote: dict[str, "RemoteFile"] = {}
"""The remote file of each stub, by the path of the stub."""


def add_stub(stub: Path, file: "RemoteFile") -> None:
    """Read a stub from a remote file from now on."""
    _remote[str(stub)] = file


def remove_stub(stub: Path) -> None:
    """Forget a stub."""
    _remote.pop(str(stub), None)


def remote_file(path: Path) -> "RemoteFile | None":
    """Return the remote file of a stub, or None for other files."""
    return _remote.get(str(path)) if _remote else None


class RemoteFile:
    """A file at a URL.

    Parameters
    ----------
    fs : fsspec.AbstractFileSystem
    path : str
        The path in the file system.
    url : str
        The URL, for messages.
    size : int
        Number of bytes.
    """

    def __init__(self, fs: Any, path: str, url: str, size: int) -> None:
        self._fs, self._path = fs, path
        self.url, self.size = url, size

    def read(self, start: int, stop: int) -> bytes:
        """Return the bytes from `start` to `stop`.

        Raises
        ------
        OSError
            When they cannot be read.
        """
        with explained(self.url):
            data: bytes = self._fs.cat_file(self._path, start=start, end=stop)
        if len(data) != stop - start:
            raise OSError(
                f"{self.url}: expected {stop - start} bytes from {start} on, got {len(data)}; the "
                "file has changed since it was opened, or its server does not support ranges"
            )
        return data
