"""The calls of the HDF5 library that jotlight needs, in this process or in a child process.

A child process runs this file as a script (see ``isolated``). To start fast, the file imports
nothing of jotlight, and it imports NumPy and h5py only when it needs them.
"""

import dataclasses
import io
import json
import math
import os
import signal
import sys
import weakref
from collections.abc import Callable
from typing import Any, BinaryIO

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_MAX_DATA_SETS = 1000
"""Maximum number of data sets that are listed for a file."""

_MAX_OPEN_FILES = 16
"""Maximum number of files that stay open. A capture may have more files."""

_MAX_MESSAGE_BYTES = 1 << 26
"""Maximum size of a message's header. The bytes of frames follow the header."""

_MEMORY = 1 << 28
"""Memory in bytes that a child process may use, plus that for the requested frames and chunks."""

SECONDS = 60
"""CPU time in seconds that a request may take, plus the time for the requested bytes."""

_BYTES_PER_SECOND = 1 << 22
"""Minimum number of requested bytes that a second of CPU time must suffice for."""


LAYOUTS = ("ordinary", "external", "virtual")
"""Where data are: in the data set, in other files, or in data sets that may be in other files."""


@dataclasses.dataclass(frozen=True)
class DataSet:
    """What an HDF5 file states about one of its data sets. A hostile file may state anything."""

    path: str
    name: str
    shape: tuple[int, ...]
    dtype: str
    chunk_bytes: int
    chunk_frames: int
    """Number of frames in a chunk, or 0 if the library decodes no chunk again to read its parts."""
    chunks: int
    """Number of chunks. For an array without chunks, its frames count as such."""
    missing_chunks: int
    """Number of chunks that were not written. 0 for a file at a URL, where counting them would
    read the whole index."""
    layout: str
    """One of `LAYOUTS`. The shape and the chunks are known only of an ordinary data set."""
    label: str | None
    """The text in the requested attribute, or None."""
    label_ignored: bool
    """Whether the attribute exists, but is not a string of fixed length. HDF5 stores other
    attributes in a heap, and the library hangs when it reads a damaged heap."""


class Hdf5Library:
    """The HDF5 library. Its methods raise any exception when a file is damaged.

    Some exceptions have another cause: ImportError means that h5py cannot be imported,
    FileNotFoundError and PermissionError mean that the file cannot be opened, and BlockingIOError
    means that another program is writing it.
    """

    def __init__(self, open_file: Callable[[str], Any] = str) -> None:
        """`open_file` returns what h5py opens for a path: the path itself, or a file object."""
        self._open_file = open_file
        self._files: dict[str, dict[str, Any]] = {}
        _LIBRARIES.add(self)

    def list_data_sets(self, path: str, attribute: str) -> list[DataSet]:
        """Return the numeric data sets of a file."""
        # HDF5 shares its caches among all who have a file open in a process. So the others close
        # their files: this one may have changed since they opened it.
        for other in set(_LIBRARIES) - {self}:
            other._files = {}
        return [
            _describe(path, name, item, attribute) for name, item in self._data_sets(path).items()
        ]

    def read(self, data_set: DataSet, start: int, stop: int) -> Any:
        """Return a part of a data set, along its first dimension, as an array."""
        return self._data_sets(data_set.path)[data_set.name][start:stop]

    def _data_sets(self, path: str) -> dict[str, Any]:
        """Return the numeric data sets of a file, which stays open for the next call."""
        import h5py

        files = self._files
        if path in files:
            return files[path]
        found: dict[str, Any] = {}

        def visit(name: str, item: Any) -> bool | None:
            is_numeric = isinstance(item, h5py.Dataset) and item.dtype.kind in "biuf"
            if is_numeric and (_layout(item) != "ordinary" or item.ndim > 0):
                found[name] = item
            return True if len(found) >= _MAX_DATA_SETS else None

        file = h5py.File(self._open_file(path), "r")
        _release_lock(file)
        # visititems follows no links, so a file cannot lead to another file.
        file.visititems(visit)
        # HDF5 closes a file when nothing refers to its data sets any more.
        while len(files) >= _MAX_OPEN_FILES:
            del files[next(iter(files))]
        files[path] = found
        return found


_LIBRARIES: weakref.WeakSet[Hdf5Library] = weakref.WeakSet()
"""All libraries of this process."""


def _release_lock(file: Any) -> None:
    """Let other programs write to a file, unless others in this process had opened it.

    The library has taken a lock, so no program was writing the file. It would keep the lock as long
    as the file is open, but who calls this module compares the state of the file with that at
    opening before and after each reading. With `locking=False`, nobody else in this process could
    open the file with a lock.
    """
    import h5py

    if fcntl is None or file.driver != "sec2":
        return
    if h5py.h5f.get_obj_count(file.id, h5py.h5f.OBJ_FILE) == 1:
        fcntl.flock(file.id.get_vfd_handle(), fcntl.LOCK_UN)


def _layout(item: Any) -> str:
    """Return the layout of a data set. The files of a virtual one are opened to know its shape."""
    if item.is_virtual:
        return "virtual"
    return "external" if item.external else "ordinary"


def _describe(path: str, name: str, item: Any, attribute: str) -> DataSet:
    if (layout := _layout(item)) != "ordinary":
        return DataSet(path, name, (), item.dtype.str, 0, 0, 0, 0, layout, None, False)
    label, ignored = None, False
    if attribute in item.attrs:
        ignored = item.attrs.get_id(attribute).dtype.kind != "S"
        label = None if ignored else bytes(item.attrs[attribute]).decode()
    return DataSet(
        path,
        name,
        tuple(map(int, item.shape)),
        item.dtype.str,
        math.prod(item.chunks or (0,)) * item.dtype.itemsize,
        _count_chunk_frames(item),
        *_count_chunks(item),
        layout,
        label,
        ignored,
    )


def _count_chunks(item: Any) -> tuple[int, int]:
    """Return the number of chunks of a data set, and of those that were not written."""
    if item.chunks is None:
        is_missing = item.size > 0 and item.id.get_storage_size() == 0
        return int(item.shape[0]), int(item.shape[0]) * is_missing
    total = math.prod(
        -(-size // chunk) for size, chunk in zip(item.shape, item.chunks, strict=True)
    )
    is_remote = item.file.driver == "fileobj"
    return total, 0 if is_remote else total - item.id.get_num_chunks()


def _count_chunk_frames(item: Any) -> int:
    """Return the number of frames in a chunk, or 0 if the library decodes no chunk again."""
    # Of chunks without filters, the library reads a part.
    if item.chunks is None or item.id.get_create_plist().get_nfilters() == 0:
        return 0
    # It caches the chunks that contain the same frames, if all of them fit into its cache.
    sizes = zip(item.shape[1:], item.chunks[1:], strict=True)
    numbers = item.chunks[0] * math.prod(-(-size // chunk) * chunk for size, chunk in sizes)
    cache_bytes = item.id.get_access_plist().get_chunk_cache()[1]
    return int(item.chunks[0]) if numbers * item.dtype.itemsize > cache_bytes else 0


def send(stream: BinaryIO, header: dict[str, Any], content: memoryview | None = None) -> None:
    """Write a message: the length of its header, the header as JSON, and raw bytes."""
    text = json.dumps(header).encode()
    stream.write(len(text).to_bytes(4, "little") + text)
    if content is not None:
        stream.write(content)
    stream.flush()


def receive(stream: BinaryIO) -> dict[str, Any]:
    """Return the header of the next message.

    Raises
    ------
    EOFError
        When the other process has ended.
    """
    length = stream.read(4)
    size = int.from_bytes(length, "little")
    if len(length) < 4 or size > _MAX_MESSAGE_BYTES:
        raise EOFError
    text = stream.read(size)
    if len(text) < size:
        raise EOFError
    header = json.loads(text)
    if not isinstance(header, dict):
        raise EOFError
    return header


class _RemoteFiles:
    """Files at URLs, whose bytes the parent process sends to this one on request."""

    def __init__(self, requests: BinaryIO, replies: BinaryIO) -> None:
        self._requests, self._replies = requests, replies
        self._sizes: dict[str, int] = {}

    def note(self, request: dict[str, Any]) -> None:
        """Note the size of the file of a request, if it is at a URL."""
        if request.get("remote_bytes") is not None:
            self._sizes[request["path"]] = request["remote_bytes"]

    def open(self, path: str) -> Any:
        """Return a file at a URL as a file object, and the path of another one."""
        size = self._sizes.get(path)
        return path if size is None else _RemoteFile(size, self._read)

    def _read(self, start: int, stop: int) -> bytes:
        send(self._replies, {"wanted": [start, stop]})
        receive(self._requests)
        return self._requests.read(stop - start)


class _RemoteFile(io.RawIOBase):
    def __init__(self, size: int, read: Callable[[int, int], bytes]) -> None:
        self._size, self._read, self._position = size, read, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._position

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        start = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self._size}[whence]
        self._position = start + offset
        return self._position

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        stop = min(self._position + len(view), self._size)
        number = max(0, stop - self._position)
        if number:
            view[:number] = self._read(self._position, stop)
        self._position += number
        return number


def _serve(requests: BinaryIO, replies: BinaryIO) -> None:
    """Answer requests until the other process closes the stream or ends."""
    remote = _RemoteFiles(requests, replies)
    library = Hdf5Library(remote.open)
    while True:
        try:
            request = receive(requests)
        except EOFError:
            return
        reply: dict[str, Any] = {}
        content = None
        try:
            _limit_resources(request)
            remote.note(request)
            if "attribute" in request:
                found = library.list_data_sets(request["path"], request["attribute"])
                reply["data_sets"] = [dataclasses.asdict(each) for each in found]
            else:
                data_set = DataSet(**request["data_set"])
                content = _raw_bytes(library.read(data_set, request["start"], request["stop"]))
                reply["bytes"] = content.nbytes
        except Exception as error:
            reply, content = {"error": type(error).__name__, "message": str(error)}, None
            if isinstance(error, ImportError):
                reply["module"] = error.name
        send(replies, reply, content)


def _raw_bytes(array: Any) -> memoryview:
    import numpy as np

    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data


def _limit_resources(request: dict[str, Any]) -> None:
    """Limit the memory and the computing time that this process may use for a request.

    The time to wait for a slow disk does not count. A process that exceeds a limit receives an
    error or ends.
    """
    if sys.platform == "win32":
        return
    import resource

    read_bytes = request.get("bytes", 0)
    chunk_bytes = request.get("data_set", {}).get("chunk_bytes", 0)
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = int(used.ru_utime + used.ru_stime) + SECONDS + read_bytes // _BYTES_PER_SECOND
    for kind, limit in (
        (resource.RLIMIT_CPU, seconds),
        # The library decompresses a whole chunk, and doubles its buffer until the chunk fits.
        (resource.RLIMIT_DATA, _MEMORY + 2 * read_bytes + 4 * chunk_bytes),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        soft = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(kind, (soft, hard))


def _main() -> None:
    # Ctrl-C also reaches this process. The one that started it decides when it ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests = sys.stdin.buffer
    # Output of the library must not mix with the replies.
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    sys.path[:] = receive(requests)["sys_path"]
    _serve(requests, replies)


if __name__ == "__main__":
    _main()
