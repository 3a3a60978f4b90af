"""The script of the child process that calls the HDF5 library (see ``isolated``).

To start fast, it imports nothing of jotlight but the file ``library``, and NumPy only when needed.
"""

import dataclasses
import importlib
import io
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    from jotlight.formats.hdf5 import library
else:
    sys.path.insert(0, str(Path(__file__).parent))
    library = importlib.import_module("library")
    sys.path.pop(0)  # other modules of this folder must not hide those of Python

_MEMORY = 1 << 28
"""Memory in bytes that a child process may use, plus that for the requested frames and chunks."""

_BYTES_PER_SECOND = 1 << 22
"""Minimum number of requested bytes that a second of CPU time must suffice for."""


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
        library.send(self._replies, {"wanted": [start, stop]})
        library.receive(self._requests)
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
    hdf5 = library.Hdf5Library(remote.open)
    while True:
        try:
            request = library.receive(requests)
        except EOFError:
            return
        reply: dict[str, Any] = {}
        content = None
        try:
            _limit_resources(request)
            remote.note(request)
            if "attribute" in request:
                found = hdf5.list_data_sets(request["path"], request["attribute"])
                reply["data_sets"] = [dataclasses.asdict(each) for each in found]
            else:
                data_set = library.DataSet(**request["data_set"])
                content = _raw_bytes(hdf5.read(data_set, request["start"], request["stop"]))
                reply["bytes"] = content.nbytes
        except Exception as error:
            reply, content = {"error": type(error).__name__, "message": str(error)}, None
            if isinstance(error, ImportError):
                reply["module"] = error.name
        library.send(replies, reply, content)


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
    seconds = int(used.ru_utime + used.ru_stime) + library.SECONDS + read_bytes // _BYTES_PER_SECOND
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
    sys.path[:] = library.receive(requests)["sys_path"]
    _serve(requests, replies)


if __name__ == "__main__":
    _main()
