"""The HDF5 library in a child process, so that a crash of the library becomes an error."""

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys
import threading
import weakref
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
import numpy.typing as npt

from jotlight.formats.files.remote_files import RemoteFile, RemoteStream, remote_file
from jotlight.formats.hdf5.library import LAYOUTS, SECONDS, DataSet, receive, send

_ERRORS = {
    each.__name__: each
    for each in (FileNotFoundError, PermissionError, BlockingIOError, ValueError)
}
"""Types of errors that the child process may report. All others become a ValueError, except those
of an import, which also name the module."""

_IMPORT_ERRORS = {each.__name__: each for each in (ImportError, ModuleNotFoundError)}
"""Types of errors of an import that the child process may report."""

_PIPE_BYTES = 1 << 20
"""Size of the pipes between the processes, where the system lets it be set."""


class IsolatedLibrary:
    """The same methods as :class:`~jotlight.formats.hdf5.library.Hdf5Library`, in a child process.

    The child process starts with the first call, and ends with this object or with this process.
    After it has crashed, every call raises the same error.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._end: weakref.finalize[..., Any] | None = None
        self._failure: str | None = None
        _LIBRARIES.add(self)

    @property
    def process_id(self) -> int | None:
        """Return the number of the child process, or None if there is none."""
        return None if self._process is None else self._process.pid

    def list_data_sets(self, path: str, attribute: str) -> list[DataSet]:
        """Return the numeric data sets of a file."""
        with self._lock:
            reply = self._ask(path, {"path": path, "attribute": attribute})
        try:
            return [_checked_data_set(path, fields) for fields in reply["data_sets"]]
        except (KeyError, TypeError) as error:
            raise ValueError(f"expected data sets, got {error}") from error

    def read(self, data_set: DataSet, start: int, stop: int) -> npt.NDArray[Any]:
        """Return a part of a data set, along its first dimension, as an array."""
        fields = dataclasses.asdict(data_set)
        size = len(range(*slice(start, stop).indices(data_set.shape[0])))
        out = np.empty((size, *data_set.shape[1:]), data_set.dtype)
        request = {"data_set": fields, "start": start, "stop": stop, "bytes": out.nbytes}
        content = out.reshape(-1).view(np.uint8).data
        with self._lock:
            self._ask(data_set.path, request, content)
        return out

    def _ask(
        self, path: str, request: dict[str, Any], content: memoryview | None = None
    ) -> dict[str, Any]:
        """Return the reply to a request, after reading the raw bytes that follow it."""
        if self._failure is not None:
            raise ValueError(self._failure)
        if self._process is None:
            self._start(path)
        process = cast("subprocess.Popen[bytes]", self._process)
        stdin, stdout = cast(BinaryIO, process.stdin), cast(BinaryIO, process.stdout)
        try:
            remote = remote_file(Path(path))
            known = {} if remote is None else {"path": path, "remote_bytes": remote.size}
            send(stdin, {**request, **known})
            reply = receive(stdout)
            while remote is not None and "wanted" in reply:
                send(stdin, {}, _remote_bytes(remote, reply["wanted"]))
                reply = receive(stdout)
            if content is not None and "error" not in reply:
                if reply.get("bytes") != content.nbytes:
                    raise ValueError(f"expected {content.nbytes} bytes, got {reply.get('bytes')}")
                if stdout.readinto(content) != content.nbytes:  # type: ignore[attr-defined]
                    raise EOFError
        except (EOFError, BrokenPipeError):
            # The child process has ended, or its reply makes no sense.
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=1)
            self._failure = _describe_end(path, process.poll())
            self.close()
            raise ValueError(self._failure) from None
        except BaseException:
            # Otherwise, the next call would read the rest of this reply.
            self.close()
            raise
        if "error" in reply:
            raise _reported_error(reply)
        return reply

    def _start(self, path: str) -> None:
        script = str(Path(__file__).with_name("child.py"))
        try:
            if not sys.executable:
                raise FileNotFoundError("sys.executable names no Python")
            # Without the module `site`, the child process starts faster. It uses our `sys.path`.
            process = subprocess.Popen(  # noqa: S603 - our own file
                [sys.executable, "-SPs", script],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                pipesize=_PIPE_BYTES,
                # OpenBLAS would allocate memory for threads, which counts against the limit.
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        except OSError as error:
            raise ChildProcessError(
                f"{path}: cannot start a process to read it ({error}); pass isolate=False "
                "(--no-isolate) if you trust the file"
            ) from error
        self._process = process
        self._end = weakref.finalize(self, _end, process)
        with contextlib.suppress(BrokenPipeError):
            send(cast(BinaryIO, process.stdin), {"sys_path": sys.path})

    def close(self) -> None:
        """End the child process. The next call starts another one."""
        if self._end is not None:
            self._end()
        self._process = self._end = None

    def forget(self) -> None:
        """Forget the child process in a fork, because it belongs to the process that started it."""
        if self._process is not None and self._end is not None:
            self._end.detach()
            self._process.returncode = 0  # so that Python does not wait for it
        self._lock, self._process, self._end = threading.Lock(), None, None


_LIBRARIES: weakref.WeakSet[IsolatedLibrary] = weakref.WeakSet()
"""All libraries of this process, which a fork of the process must forget."""


def _forget_all() -> None:
    for each in list(_LIBRARIES):
        each.forget()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_all)


def _end(process: "subprocess.Popen[bytes]") -> None:
    # The process only reads, so killing it damages nothing.
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        # Closing writes the rest of the buffer, and fails because nobody reads it.
        with contextlib.suppress(OSError):
            cast(BinaryIO, stream).close()


def _remote_bytes(file: RemoteFile, wanted: Any) -> memoryview:
    """Return the bytes that the child process wants to know."""
    start, stop = map(int, wanted)
    if not 0 <= start < stop <= file.size:
        raise ValueError(f"expected a part of {file.size} bytes, got {start} to {stop}")
    stream = RemoteStream(file)
    stream.seek(start)
    return memoryview(stream.read(stop - start) or b"")


def _checked_data_set(path: str, fields: dict[str, Any]) -> DataSet:
    data_set = DataSet(**{**fields, "path": path, "shape": tuple(fields["shape"])})
    sizes = (
        *data_set.shape,
        *(data_set.chunk_bytes, data_set.chunk_frames, data_set.chunks, data_set.missing_chunks),
    )
    if not all(type(size) is int and size >= 0 for size in sizes):
        raise TypeError(f"a shape and chunks of {sizes}")
    kinds = "V" if data_set.layout == "compound" else "biuf"
    if not isinstance(data_set.name, str) or np.dtype(data_set.dtype).kind not in kinds:
        raise TypeError(f"an array {data_set.name!r} of {data_set.dtype!r}")
    if not all(type(each) is int for each in data_set.missing_filters):
        raise TypeError(f"filters {data_set.missing_filters!r}")
    if data_set.layout not in LAYOUTS:
        raise TypeError(f"a layout {data_set.layout!r}")
    if not isinstance(data_set.label, str | None):
        raise TypeError(f"a label {data_set.label!r}")
    return data_set


def _reported_error(reply: dict[str, Any]) -> Exception:
    """Return the error that the child process reports."""
    kind, message = str(reply["error"]), str(reply.get("message"))
    if kind in _IMPORT_ERRORS:
        return _IMPORT_ERRORS[kind](message, name=reply.get("module"))
    return _ERRORS.get(kind, ValueError)(message)


def _describe_end(path: str, status: int | None) -> str:
    if status is not None and status == -getattr(signal, "SIGXCPU", 0):
        return (
            f"{path}: the HDF5 library computed for {SECONDS} s or more without an end; "
            "the file is damaged or hostile"
        )
    if status is not None and status < 0:
        name = signal.Signals(-status).name
        return (
            f"{path}: the HDF5 library crashed while reading it ({name}); "
            "the file is damaged or hostile"
        )
    end = "stopped answering" if status is None else f"ended with status {status}"
    return f"{path}: the process that reads it {end}; the file is damaged or hostile"
