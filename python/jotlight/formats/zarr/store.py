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

from jotlight.errors import ChangedFileError
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.remote_files import RemoteFile, remote_file
from jotlight.formats.zarr.codecs import ChunkSizes, bound_codecs
from jotlight.formats.zarr.manifest import MAX_METADATA_BYTES, METADATA_FILES
from jotlight.formats.zarr.shards import check_index, index_bytes, is_shard, parts_of_shard

_NO_CHUNKS = ChunkSizes(0, 0, 0, 1)
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
        self._kept: tuple[str, dict[int, str]] | None = None  # the last index of a shard

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
            content = value.as_numpy_array().tobytes()
            await asyncio.to_thread(self._compare, key, content, byte_range)
        return value

    def _compare(self, key: str, content: bytes, byte_range: Any) -> None:
        """Compare the checksums of a chunk, or of a part of a shard, with those of the manifest."""
        assert self._checksums is not None, "a manifest"
        stored = self._checksums.get(key, "")
        if not is_shard(stored):
            expected = stored
        elif isinstance(byte_range, RangeByteRequest):
            index = self._index(key, stored)
            expected = index.get(byte_range.start, "")
        elif isinstance(byte_range, SuffixByteRequest):
            check_index(content, stored)
            return
        else:
            chunks = self._sizes.chunks_per_file
            parts = parts_of_shard(content, chunks)
            check_index(parts[-1], stored)
            expected, content = stored, b"".join(part[-4:] for part in parts)
            if content.hex() != expected:
                raise ValueError(f"{key} is not the shard that jotlight wrote")
            return
        if content[-4:].hex() != expected:
            raise ValueError(f"{key} is not the chunk that jotlight wrote")

    def _index(self, key: str, stored: str) -> dict[int, str]:
        """Return the checksum of each chunk of a shard by its position."""
        if self._kept is None or self._kept[0] != key:
            file, size = self._files[key], index_bytes(self._sizes.chunks_per_file)
            index = file.read(file.size - size, size).tobytes()
            self._kept = key, check_index(index, stored)
        return self._kept[1]

    def _check_unchanged(self, key: str) -> None:
        if key in self._files:
            self._files[key].check_unchanged()
        elif (self.root / key).exists():
            raise ChangedFileError(
                f"{self.root / key}: was added after the folder was opened; open the folder again "
                "when it is complete"
            )

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
