"""Reading of the files of a zarr folder, with limits on their sizes and a check of the manifest."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.abc.store import RangeByteRequest, SuffixByteRequest
from zarr.storage import LocalStore, StorePath

from jotlight.formats.safe_paths import check_inside
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
    folder : path
        The folder that the user passed. Links may not lead out of it.
    sizes : ChunkSizes, optional
        Limits on the files of chunks. Default: only metadata can be read.
    checksums : mapping, optional
        The stored CRC-32C of each chunk, in hexadecimal digits. Default: there is no manifest.
    """

    def __init__(
        self,
        root: Path,
        folder: Path,
        *,
        sizes: ChunkSizes = _NO_CHUNKS,
        checksums: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(root, read_only=True)
        self._folder = folder
        self._sizes, self._checksums = sizes, checksums

    async def get(self, key: str, prototype: Any = None, byte_range: Any = None) -> Any:
        """Return the content of a file, or None if it does not exist.

        Raises
        ------
        ValueError
            When the file is too large, or a link leads out of the folder, or a chunk is not the
            one that the manifest lists.
        """
        await asyncio.to_thread(self._check, key, byte_range)
        value = await super().get(key, prototype, byte_range)
        if self._checksums is not None and not self._is_metadata(key):
            if value is None:
                raise ValueError(f"{key} is missing")
            if value.as_numpy_array()[-4:].tobytes().hex() != self._checksums.get(key):
                raise ValueError(f"{key} is not the chunk that jotlight wrote")
        return value

    def _is_metadata(self, key: str) -> bool:
        return key in METADATA_FILES

    def _check(self, key: str, byte_range: Any) -> None:
        path = self.root / key
        if not path.exists():
            return
        size, limit = check_inside(path, self._folder).stat().st_size, self._sizes.file
        if self._is_metadata(key):
            limit = MAX_METADATA_BYTES
        if size > limit:
            raise ValueError(f"{key} has {size} bytes, expected at most {limit}")
        if isinstance(byte_range, RangeByteRequest):
            size = byte_range.end - byte_range.start
        elif isinstance(byte_range, SuffixByteRequest):
            size = byte_range.suffix
        if byte_range is not None and size > self._sizes.part:
            raise ValueError(f"{key}: a chunk in it has {size} bytes, more than expected")


def open_bounded_array(
    root: Path, folder: Path, checksums: Mapping[str, str] | None
) -> tuple[Any, ChunkSizes]:
    """Return the ``zarr.Array`` in a folder, which takes limited memory when it is read.

    See :class:`BoundedStore` for the parameters. Damaged metadata raise any exception.
    """
    array = zarr.open_array(BoundedStore(root, folder), mode="r")
    metadata, sizes = bound_codecs(array.metadata, np.dtype(array.dtype).itemsize)
    store = BoundedStore(root, folder, sizes=sizes, checksums=checksums)
    bounded = zarr.AsyncArray(metadata=metadata, store_path=StorePath(store))
    return zarr.Array(bounded), sizes
