"""zarr folders: an array of packed bits, of booleans, or of counts. Requires the extra `zarr`."""

import dataclasses
import functools
import json
import math
import operator
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import ChangedFileError
from jotlight.formats.capture import Capture
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.limits import (
    check_frame_size,
    check_missing_chunks,
)
from jotlight.formats.files.remote_files import raise_failure
from jotlight.formats.files.safe_paths import list_below
from jotlight.formats.format import Format, Writer
from jotlight.formats.frames.blocks import read_by_blocks
from jotlight.formats.frames.labeled import ATTRIBUTE, ListedArray, StoredArray, open_stored_array
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.zarr.manifest import (
    MANIFEST,
    MANIFESTS,
    MAX_METADATA_BYTES,
    METADATA_FILES,
    read_manifest,
    verify_chunks,
)
from jotlight.formats.zarr.writing import import_zarr, write_bits, write_counts
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.maps import MAPS
from jotlight.sensing.parameters.provenance import Provenance

_MAX_ARRAYS = 1000
"""Maximum number of files that describe arrays and groups."""

_MAX_READ_BYTES, _MAX_READ_CHUNKS = 1 << 26, 1 << 12
"""Maximum size and number of the chunks that are read at once. A single chunk may be larger."""

_MAX_MISSING = 1000
"""Maximum number of missing chunks for each existing one. Ten more are assumed to exist."""


def _is_zarr(path: Path) -> bool:
    return any((path / name).is_file() for name in (*METADATA_FILES, *MANIFESTS))


def open_zarr(path: Path, options: ReadingOptions) -> Capture:
    """Return the capture in an array of a zarr folder."""
    import_zarr()
    if not path.is_dir():
        raise FileNotFoundError(f"there is no folder {path}")
    folder = _list_folder(path)
    names = folder.arrays()
    key = options.path_key
    if key in names:
        # Descriptions of other arrays are read only if they may be maps of the sensor.
        names = [name for name in (key, *MAPS) if name in names]
    arrays = {name: _list_array(folder, name) for name in names}
    return open_stored_array(arrays, Provenance("zarr", path.name), options)


@dataclasses.dataclass(frozen=True)
class _Folder:
    """A zarr folder, with its files by name."""

    path: Path
    files: Mapping[str, FileReader]
    checksums: Mapping[str, str] | None
    """The stored CRC-32C of each chunk, or None if jotlight did not write the folder."""

    def arrays(self) -> list[str]:
        """Return the names of the arrays; the name of an array in the root is `.`."""
        described = sorted(
            Path(name) for name in self.files if name.rpartition("/")[2] in METADATA_FILES
        )
        if len(described) > _MAX_ARRAYS:
            raise ValueError(f"{self.path}: expected at most {_MAX_ARRAYS} arrays, got more")
        found = {file.parent.as_posix() for file in described if self._describes_array(file)}
        if not found:
            raise ValueError(f"{self.path}: expected a zarr folder with an array in it")
        return sorted(found)

    def files_of(self, array: str) -> dict[str, FileReader]:
        """Return the files of an array, with names relative to its folder."""
        prefix = "" if array == "." else f"{array}/"
        return {
            name.removeprefix(prefix): file
            for name, file in self.files.items()
            if name.startswith(prefix)
        }

    def checksums_of(self, array: str) -> dict[str, str] | None:
        """Return the checksums of the chunks of an array, with names relative to its folder."""
        prefix = "" if array == "." else f"{array}/"
        if self.checksums is None:
            return None
        return {
            name.removeprefix(prefix): checksum
            for name, checksum in self.checksums.items()
            if name.startswith(prefix)
        }

    def _describes_array(self, name: Path) -> bool:
        from jotlight.formats.zarr.codecs import check_codec_names

        path = self.path / name
        try:
            if self.files[name.as_posix()].size > MAX_METADATA_BYTES:
                raise ValueError("it is too long")
            metadata = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(metadata, dict):
                raise ValueError("expected an object")
            is_array = path.name != ".zattrs" and "shape" in metadata
            if is_array:
                check_codec_names(metadata)
        except (ValueError, RecursionError) as error:
            raise ValueError(
                f"{path}: the description of the array is damaged ({error})"
            ) from error
        return is_array


def _list_folder(path: Path) -> _Folder:
    """Return a folder whose links do not lead out of it, and whose files fit its manifest."""
    found = list_below(path)
    files = {file.relative_to(path).as_posix(): FileReader(file) for file in found}
    return _Folder(path, files, read_manifest(path, files))


def _list_array(folder: _Folder, name: str) -> ListedArray:
    """Return an array with its label, which is in the description of the array."""
    from jotlight.formats.zarr.store import open_bounded_array

    path = folder.path / name
    try:
        array, sizes = open_bounded_array(path, folder.files_of(name), folder.checksums_of(name))
        label = array.attrs.get(ATTRIBUTE)
    except Exception as error:  # the library raises many exceptions for damaged folders
        raise ValueError(f"{path}: the array is damaged ({error})") from error
    return ListedArray(
        label if isinstance(label, str) else None,
        functools.partial(_open_array, folder, name, array, label, sizes.chunk),
    )


def _open_array(
    folder: _Folder, name: str, array: Any, label: object, chunk_bytes: int
) -> StoredArray:
    from jotlight.formats.zarr.codecs import MAX_CHUNK_BYTES

    path, files = folder.path / name, folder.files_of(name)
    shape, dtype = tuple(array.shape), np.dtype(array.dtype)
    if dtype.kind not in "biuf" or not shape or not 0 <= min(shape) <= max(shape) < 2**63:
        raise ValueError(f"{path}: expected an array of numbers, got {dtype} of shape {shape}")
    if min(*array.chunks, *(array.shards or array.chunks)) < 1:
        raise ValueError(f"{path}: expected chunks of 1 or more numbers, got {array.chunks}")
    if isinstance(label, dict) and "run" in label:
        raise ValueError(
            f"{path}: holds images of a run, not a capture; `jotlight info` describes them, and "
            "dask.array.from_zarr or zarr.open_array reads them"
        )
    if label is not None and folder.checksums is None:
        raise ValueError(
            f"{path}: jotlight wrote this array, but its list of files {MANIFEST} is missing; open "
            "the zarr folder that contains it, or restore it from a copy"
        )
    chunks = _find_chunks(array, files)
    file_bytes = sum(files[name].size for name in chunks)
    # The size of a chunk has a limit of its own, and the chunks are read one after the other.
    frame_bytes = math.prod(shape[1:] if len(shape) > 2 else shape) * dtype.itemsize
    check_frame_size(str(path), frame_bytes, file_bytes)
    _check_missing_chunks(path, array, len(chunks))
    max_chunks = min(max(1, _MAX_READ_BYTES // chunk_bytes), _MAX_READ_CHUNKS)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        part = np.empty((stop - start, *shape[1:]), dtype)
        region = (slice(start, stop), *(slice(0, length) for length in shape[1:]))
        try:
            for block in _split(region, tuple(array.chunks), max_chunks):
                rows = slice(block[0].start - start, block[0].stop - start)
                part[(rows, *block[1:])] = array[block]
        except (ChangedFileError, FileNotFoundError):
            raise
        except Exception as error:
            raise_failure(file.path for file in files.values())
            raise ValueError(f"{path}: a chunk is damaged ({error})") from error
        return part

    frames = read_by_blocks(Frames(shape, read, dtype), array.chunks[0], MAX_CHUNK_BYTES)
    return StoredArray(frames, file_bytes)


def _split(
    region: tuple[slice, ...], chunks: tuple[int, ...], max_chunks: int
) -> Iterator[tuple[slice, ...]]:
    """Yield parts of a region that touch at most `max_chunks` chunks of this shape each."""
    pairs = list(zip(region, chunks, strict=True))
    first = [place.start // size for place, size in pairs]
    number = [-(-place.stop // size) - low for (place, size), low in zip(pairs, first, strict=True)]
    if math.prod(number) <= max_chunks:
        yield region
        return
    axis = next(axis for axis, touched in enumerate(number) if touched > 1)
    middle = (first[axis] + number[axis] // 2) * chunks[axis]
    for half in (slice(region[axis].start, middle), slice(middle, region[axis].stop)):
        yield from _split((*region[:axis], half, *region[axis + 1 :]), chunks, max_chunks)


def _chunk_grid(array: Any) -> list[int]:
    """Return the number of files of chunks or shards along each dimension."""
    shape = array.shards or array.chunks
    return [-(-length // size) for length, size in zip(array.shape, shape, strict=True)]


def _find_chunks(array: Any, files: Iterable[str]) -> list[str]:
    """Return the names of those files that are chunks or shards of an array."""
    grid = _chunk_grid(array)

    def is_chunk(name: str) -> bool:
        place = tuple(map(int, re.findall("[0-9]+", name)))[-len(grid) :]
        inside = len(place) == len(grid) and all(map(operator.lt, place, grid))
        return inside and array.metadata.encode_chunk_key(place) == name

    return list(filter(is_chunk, files))


def _check_missing_chunks(path: Path, array: Any, found: int) -> None:
    """Warn if only `found` chunks are in the folder, and raise ValueError if nearly all are not."""
    kind, fill_value = "shards" if array.shards else "chunks", array.metadata.fill_value or 0
    reason = f"are read as {fill_value}; zarr omits {kind} that hold nothing else"
    total = math.prod(_chunk_grid(array))
    check_missing_chunks(str(path), found, total, _MAX_MISSING, kind=kind, reason=reason)


def _verify(path: Path) -> int:
    """Compare all files with the manifest, and return their number, or 0 without a manifest."""
    folder = _list_folder(path)
    if folder.checksums is None:
        return 0
    metadata = sum(name.rpartition("/")[2] in METADATA_FILES for name in folder.files)
    return metadata + verify_chunks(path, folder.checksums)


ZARR = Format(
    "zarr",
    "an array in a zarr folder",
    open=open_zarr,
    matches=_is_zarr,
    has_keys=True,
    verify=_verify,
    writer=Writer(
        bits=write_bits,
        counts=write_counts,
        extensions=(".zarr",),
        folder=True,
        keeps_sensor=True,
        keeps_label=True,
    ),
)
