"""The calls of the HDF5 library that jotlight needs, in this process or in a child process.

A child process loads this file alone (see ``child``). To start fast, the file imports nothing of
jotlight, and it imports h5py only when it needs it.
"""

import contextlib
import dataclasses
import importlib
import json
import math
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

SECONDS = 60
"""CPU time in seconds that a request may take, plus the time for the requested bytes."""

LAYOUTS = ("ordinary", "external", "virtual", "compound")
"""Where the elements of a data set are: in the file, in other files, or in data sets that may be in
other files. The elements of a compound data set are no numbers."""


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
    missing_filters: tuple[int, ...]
    """The numbers of the filters that the library lacks, but needs to decode the chunks."""
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
        """Return the numeric data sets of a file, or if there are none, the compound ones."""
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
        """Return the data sets of a file that is to stay open for the next call."""
        import h5py

        files = self._files
        if path in files:
            return files[path]
        found: dict[str, Any] = {}
        compound: dict[str, Any] = {}

        def visit(name: str, item: Any) -> bool | None:
            kind = item.dtype.kind if isinstance(item, h5py.Dataset) else ""
            if kind == "V" and len(compound) < _MAX_DATA_SETS:
                compound[name] = item
            elif kind in tuple("biuf") and (_layout(item) != "ordinary" or item.ndim > 0):
                found[name] = item
            return True if len(found) >= _MAX_DATA_SETS else None

        file = h5py.File(self._open_file(path), "r")
        _release_lock(file)
        # visititems follows no links, so a file cannot lead to another file.
        file.visititems(visit)
        # HDF5 closes a file when nothing refers to its data sets any more.
        while len(files) >= _MAX_OPEN_FILES:
            del files[next(iter(files))]
        files[path] = found or compound
        return files[path]


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
    """Return the layout of a data set, without its shape, for which HDF5 may open other files."""
    if item.dtype.kind == "V":
        return "compound"
    if item.is_virtual:
        return "virtual"
    return "external" if item.external else "ordinary"


def _describe(path: str, name: str, item: Any, attribute: str) -> DataSet:
    if (layout := _layout(item)) != "ordinary":
        return DataSet(path, name, (), item.dtype.str, 0, 0, 0, 0, layout, (), None, False)
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
        _find_missing_filters(item),
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


def _find_missing_filters(item: Any) -> tuple[int, ...]:
    """Return the numbers of the filters of a data set that the library lacks.

    The package hdf5plugin, if it is installed, adds filters to the library when it is imported.
    """
    import h5py

    properties = item.id.get_create_plist()
    filters = [properties.get_filter(index)[0] for index in range(properties.get_nfilters())]
    if not all(map(h5py.h5z.filter_avail, filters)):
        with contextlib.suppress(ImportError):
            importlib.import_module("hdf5plugin")
    return tuple(each for each in filters if not h5py.h5z.filter_avail(each))


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
