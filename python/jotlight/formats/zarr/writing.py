"""Writing of zarr folders whose chunks all exist, end in a checksum, and are listed."""

import asyncio
import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Counts
from jotlight.errors import import_extra
from jotlight.files import atomic_folder
from jotlight.formats.frames.labeled import ATTRIBUTE, bits_label
from jotlight.formats.frames.labels import COUNTS, VERSION
from jotlight.formats.zarr.manifest import BITS_ARRAY, write_manifest
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames

_CHUNK_BYTES = 1 << 23
"""Approximate size in bytes of the chunks that jotlight writes."""

_SHARD_CHUNKS = 16
"""Maximum number of chunks in a file."""

_PATIENCE = 10.0
"""Maximum time in seconds until the writes of an interrupted call have ended."""


def import_zarr() -> Any:
    """Return the library zarr."""
    return import_extra("zarr", "zarr", "zarr folders")


def write_bits(bits: Bits, path: Path) -> None:
    """Write bits as an array, or as a group of arrays if the sensor has maps."""
    zarr = import_zarr()
    maps = bits.sensor.maps() if bits.sensor is not None else {}
    with _zarr_folder(path) as folder:
        if maps:
            zarr.create_group(str(folder))
        for name, map_ in maps.items():
            _write_array(folder, name, map_, map_.dtype)
        array = BITS_ARRAY if maps else None
        _write_array(folder, array, bits.packed, np.uint8, bits_label(bits))
        write_manifest(folder, folder / BITS_ARRAY if maps else folder)


def write_counts(counts: Counts, path: Path, label: str | None) -> None:
    """Write counts as an array, which has a label in any case."""
    # Without a label, jotlight could not notice that the manifest is missing.
    label = label or json.dumps({"format": COUNTS, "version": VERSION})
    with _zarr_folder(path) as folder:
        _write_array(folder, None, counts, np.int32, label)
        write_manifest(folder, folder)


@contextlib.contextmanager
def _zarr_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder, and rename it at the end, when zarr no longer writes into it."""
    with atomic_folder(path) as folder:
        try:
            yield folder
        finally:
            _wait_for_tasks()


def _wait_for_tasks() -> None:
    """Wait until the tasks of zarr have ended. If a call is interrupted, its task goes on."""
    from zarr.core.sync import sync

    async def wait() -> None:
        others = asyncio.all_tasks() - {asyncio.current_task()}
        if others:
            await asyncio.wait(others, timeout=_PATIENCE)

    sync(wait())


def _write_array(
    folder: Path,
    name: str | None,
    values: npt.NDArray[Any] | Frames,
    dtype: npt.DTypeLike,
    label: str | None = None,
) -> None:
    """Write an array, all of whose chunks are written and end in a checksum."""
    zarr = import_zarr()
    chunks = _chunk_shape(values.shape, np.dtype(dtype).itemsize)
    shards = _shard_shape(values.shape, chunks)
    array = zarr.create_array(
        str(folder),
        name=name,
        shape=values.shape,
        chunks=chunks,
        shards=shards,
        dtype=dtype,
        compressors=[zarr.codecs.ZstdCodec(), zarr.codecs.Crc32cCodec()],
        attributes={} if label is None else {ATTRIBUTE: label},
        config={"write_empty_chunks": True},
    )
    # Each write covers complete chunks or shards, so none is written twice.
    step = (shards or chunks)[0]
    for start in range(0, array.shape[0], step):
        place = slice(start, min(start + step, array.shape[0]))
        array[place] = np.asarray(values[place, ...])


def _shard_shape(shape: tuple[int, ...], chunks: tuple[int, ...]) -> tuple[int, ...] | None:
    """Return the shape of files of up to 16 chunks, or None where one chunk is a file.

    Large files are faster on the disks of networks, and a copy of a capture has fewer files.
    """
    number = -(-shape[0] // chunks[0])
    if min(number, _SHARD_CHUNKS) < 2 or chunks[1:] != shape[1:]:
        return None
    return (chunks[0] * min(number, _SHARD_CHUNKS), *chunks[1:])


def _chunk_shape(shape: tuple[int, ...], itemsize: int) -> tuple[int, ...]:
    """Return the shape of chunks of about 8 MiB: as many whole frames, rows, and so on as fit."""
    chunks, size = [], itemsize
    for length in reversed(shape):
        chunks.append(max(1, min(length, _CHUNK_BYTES // size)))
        size *= chunks[-1]
    return tuple(reversed(chunks))
