"""Reading of the files of a zarr folder, with limits on their sizes and a check of the manifest."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.abc.store import OffsetByteRequest, RangeByteRequest, SuffixByteRequest
from zarr.core.buffer import default_buffer_prototype
from zarr.storage import LocalStore, StorePath

from jotlight.formats.file_reader import FileReader
from jotlight.formats.stubs import RemoteFile, remote_file
from jotlight.formats.zarr.codecs import ChunkSizes, bound_codecs
from jotlight.formats.zarr.manifest import MAX_METADATA_BYTES, METADATA_FILES

_NO_CHUNKS = ChunkSizes(0, 0, 0)
"""Limits of a store that can only read metadata."""


class BoundedStore(LocalStore):
    """The files of one array, which are read only if they have the expected sizes and checksums.

    Parameters
    ----------
    root : path
        The folder of the array.
    files : mapping
        The files in that folder by name, as they were when it was opened.
    sizes : ChunkSizes, optional
        Limits on the files of chunks. Default: only metadata can be read.
    checksums : mapping, optional
        The stored CRC-32C of each chunk, in hexadecimal digits. Default: there is no manifest.
    """

    def __init__(
        self,
        root: Path,
        files: Mapping[str, FileReader],
        *,
        sizes: ChunkSizes = _NO_CHUNKS,
        checksums: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(root, read_only=True)
        self._files = files
        self._sizes, self._checksums = sizes, checksums

    async def get(self, key: str, prototype: Any = None, byte_range: Any = None) -> Any:
        """Return the content of a file, or None if it does not exist.

        Raises
        ------
        OSError
            When the file has changed since the folder was opened.
        ValueError
            When the file is empty or too large, or is not the chunk that the manifest lists.
        """
        await asyncio.to_thread(self._check, key, byte_range)
        remote = remote_file(self.root / key) if key in self._files else None
        if remote is None:
            value = await super().get(key, prototype, byte_range)
        else:
            value = await asyncio.to_thread(_read_remote, remote, prototype, byte_range)
        await asyncio.to_thread(self._check_unchanged, key)
        if self._checksums is not None and key not in METADATA_FILES:
            if value is None:
                raise ValueError(f"{key} is missing")
            if value.as_numpy_array()[-4:].tobytes().hex() != self._checksums.get(key):
                raise ValueError(f"{key} is not the chunk that jotlight wrote")
        return value

    def _check_unchanged(self, key: str) -> None:
        if key in self._files:
            self._files[key].check_unchanged()
        elif (self.root / key).exists():
            raise OSError(f"{key} was added after the folder was opened; open it again")

    def _check(self, key: str, byte_range: Any) -> None:
        self._check_unchanged(key)
        if key not in self._files:
            return
        size, limit = self._files[key].size, self._sizes.file
        if key in METADATA_FILES:
            limit = MAX_METADATA_BYTES
        # The zarr library reads an empty shard as if it were missing.
        if not 0 < size <= limit:
            raise ValueError(f"{key} has {size} bytes, expected 1 to {limit}")
        if isinstance(byte_range, RangeByteRequest):
            size = byte_range.end - byte_range.start
        elif isinstance(byte_range, SuffixByteRequest):
            size = byte_range.suffix
        if byte_range is not None and size > self._sizes.part:
            raise ValueError(f"{key}: a chunk in it has {size} bytes, more than expected")


def _read_remote(remote: RemoteFile, prototype: Any, byte_range: Any) -> Any:
    """Return a range of a remote file as a buffer of zarr."""
    start, stop = 0, remote.size
    if isinstance(byte_range, RangeByteRequest):
        start, stop = byte_range.start, min(byte_range.end, remote.size)
    elif isinstance(byte_range, SuffixByteRequest):
        start = max(0, remote.size - byte_range.suffix)
    elif isinstance(byte_range, OffsetByteRequest):
        start = min(byte_range.offset, remote.size)
    prototype = prototype or default_buffer_prototype()
    return prototype.buffer.from_bytes(remote.read(start, stop))


def open_bounded_array(
    root: Path, files: Mapping[str, FileReader], checksums: Mapping[str, str] | None
) -> tuple[Any, ChunkSizes]:
    """Return the ``zarr.Array`` in a folder, which takes limited memory when it is read.

    See :class:`BoundedStore` for the parameters. Damaged metadata raise any exception.
    """
    array = zarr.open_array(BoundedStore(root, files), mode="r")
    metadata, sizes = bound_codecs(array.metadata, np.dtype(array.dtype).itemsize)
    store = BoundedStore(root, files, sizes=sizes, checksums=checksums)
    bounded = zarr.AsyncArray(metadata=metadata, store_path=StorePath(store))
    return zarr.Array(bounded), sizes
