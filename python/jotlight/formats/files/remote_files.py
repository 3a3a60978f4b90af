"""Files at URLs, for which empty local files stand: the stubs.

A stub has the size of its file, but not its content. :func:`open_binary` and
:class:`jotlight.formats.files.file_reader.FileReader` read the content from the URL, in ranges.
"""

import io
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, cast

from jotlight.errors import ChangedFileError
from jotlight.formats.files.file_systems import content_tags, current_info, explained
from jotlight.formats.files.locks import ProcessLock

BLOCK_BYTES = 1 << 14
"""Number of bytes that are read at a time where a library reads fewer."""

_MAX_CACHED_BYTES = 1 << 17
"""Number of bytes up to which a part is read in blocks."""

_MAX_AHEAD = 64
"""Maximum number of blocks that are read at a time when a file is read in order."""

_KEPT_BLOCKS = 4096
"""Number of blocks that a process keeps, of all files together."""

_remote: dict[str, "RemoteFile"] = {}
"""The remote file of each stub, by the path of the stub."""


def add_stub(stub: Path, file: "RemoteFile") -> None:
    """Create a stub, which is read from a remote file from now on."""
    with stub.open("wb") as out:
        out.truncate(file.size)
    _remote[str(stub)] = file


def remove_stubs(stubs: list[Path]) -> None:
    """Forget stubs, and the blocks of their files."""
    files = {_remote.pop(str(stub), None) for stub in stubs}
    with _lock:
        for key in [key for key in _blocks if key[0] in files]:
            del _blocks[key]


def remote_file(path: Path) -> "RemoteFile | None":
    """Return the remote file of a stub, or None for other files."""
    return _remote.get(str(path)) if _remote else None


def open_binary(path: Path) -> BinaryIO:
    """Return a file that is open for reading. A stub yields the content of its remote file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a"
    >>> _ = path.write_bytes(b"abc")
    >>> with open_binary(path) as file:
    ...     file.read()
    b'abc'
    """
    remote = remote_file(path)
    return path.open("rb") if remote is None else cast(BinaryIO, RemoteStream(remote))


def raise_failure(paths: Iterable[Path]) -> None:
    """Raise the error with which the last reading of one of some stubs failed, if it did.

    Libraries report such an error as damage of the file.
    """
    for path in paths:
        remote = remote_file(path)
        if remote is not None and remote.failure is not None:
            raise remote.failure


class RemoteFile:
    """A file at a URL.

    Parameters
    ----------
    fs : fsspec.AbstractFileSystem
    path : str
        The path in the file system.
    url : str
        The URL, for messages.
    info : mapping
        What the file system states about the file.

    Raises
    ------
    OSError
        When the size of the file is unknown.
    """

    def __init__(self, fs: Any, path: str, url: str, info: Mapping[str, Any]) -> None:
        if info.get("size") is None:
            raise OSError(f"{url}: its server does not state the size of the file")
        self._fs, self._path, self.url = fs, path, url
        self.size = int(info["size"])
        """Number of bytes."""
        self._tags = content_tags(info)
        self.failure: OSError | None = None
        """The error of the last reading, if it failed."""

    def read(self, start: int, stop: int) -> bytes:
        """Return the bytes from `start` to `stop`.

        Raises
        ------
        OSError
            When they cannot be read, or the file has changed since it was opened.
        """
        self.failure = None
        try:
            return self._read(start, stop)
        except OSError as error:
            # A copy, because the traceback would keep the stub alive.
            self.failure = type(error)(str(error))
            raise

    def _read(self, start: int, stop: int) -> bytes:
        if start == stop:
            return b""
        with explained(self.url):
            data: bytes = self._fs.cat_file(self._path, start=start, end=stop)
        self.check_unchanged()
        if len(data) != stop - start:
            raise OSError(
                f"{self.url}: expected {stop - start} bytes from {start} on, got {len(data)}; its "
                "server does not support ranges"
            )
        return data

    def check_unchanged(self) -> None:
        """Raise ChangedFileError when the file has changed since it was opened.

        If its server states no tag and no time of a change, only the sizes are compared.
        """
        with explained(self.url):
            info = current_info(self._fs, self._path)
        tags, opened = content_tags(info), self._tags
        common = next((name for name in tags if name in opened), None)
        if info.get("size") != self.size or (common and tags[common] != opened[common]):
            raise ChangedFileError.of_file(self.url)


class RemoteStream(io.RawIOBase):
    """A remote file, opened for reading by a library.

    Small parts are read in blocks, of which the process keeps those that it used last. Reading in
    order takes more and more blocks at a time.
    """

    def __init__(self, file: RemoteFile) -> None:
        self._file, self._position = file, 0
        self._next, self._ahead = -1, 1

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def tell(self) -> int:
        """Return the position."""
        return self._position

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a position, and return it."""
        start = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self._file.size}[whence]
        self._position = max(0, start + offset)
        return self._position

    def readall(self) -> bytes:
        """Return everything from the position on."""
        return self.read(max(0, self._file.size - self._position)) or b""

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer, unless the file ends, and return the number of bytes."""
        view = memoryview(buffer).cast("B")
        start, stop = self._position, min(self._position + len(view), self._file.size)
        if stop <= start:
            return 0
        if stop - start > _MAX_CACHED_BYTES:
            view[: stop - start] = self._file.read(start, stop)
        else:
            for index in range(start // BLOCK_BYTES, (stop - 1) // BLOCK_BYTES + 1):
                first = index * BLOCK_BYTES
                low, high = max(start, first), min(stop, first + BLOCK_BYTES)
                block = self._block(index, (stop - 1) // BLOCK_BYTES + 1)
                view[low - start : high - start] = block[low - first : high - first]
        self._position = stop
        return stop - start

    def _block(self, index: int, stop: int) -> bytes:
        """Return a block. If it is missing, read it, and those up to block `stop` or further."""
        key = self._file, index
        with _lock:
            if key in _blocks:
                _blocks.move_to_end(key)
                return _blocks[key]
        self._ahead = min(2 * self._ahead, _MAX_AHEAD) if index == self._next else 1
        self._next = max(stop, index + self._ahead)
        end = min(self._next * BLOCK_BYTES, self._file.size)
        data = self._file.read(index * BLOCK_BYTES, end)
        parts = [data[at : at + BLOCK_BYTES] for at in range(0, len(data), BLOCK_BYTES)]
        with _lock:
            for number, part in enumerate(parts, index):
                _blocks[self._file, number] = part
            while len(_blocks) > _KEPT_BLOCKS:
                _blocks.popitem(last=False)
        return parts[0]


_blocks: OrderedDict[tuple[RemoteFile, int], bytes] = OrderedDict()
_lock = ProcessLock()
