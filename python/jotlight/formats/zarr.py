"""zarr folders: an array of packed bits, of booleans, or of counts. Requires the extra `zarr`."""

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import Counts
from jotlight.errors import MissingExtraError
from jotlight.files import atomic_folder
from jotlight.formats.capture import Capture
from jotlight.formats.format import Format, OpenOptions, Writer
from jotlight.formats.labeled import ATTRIBUTE, StoredArray, bits_label, open_stored_array
from jotlight.formats.limits import check_claimed_size
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames
from jotlight.sensing.maps import MAPS
from jotlight.sensing.provenance import Provenance

_METADATA_FILES = ("zarr.json", ".zarray", ".zgroup")
"""Names of the files that describe an array or a group, in versions 3 and 2 of zarr."""

_MAX_ARRAYS = 1000
"""Maximum number of arrays that are listed for a folder."""

_MAX_METADATA_BYTES = 1 << 22

_MAX_CHUNK_BYTES = 1 << 28
"""Maximum size of a chunk in bytes. The library decompresses a chunk as a whole."""

_WRITTEN_CHUNK_BYTES = 1 << 23

_SAFE_CODECS = {
    *("blosc", "bz2", "gzip", "lz4", "lzma", "zlib", "zstd", "crc32", "crc32c", "adler32"),
    *("bytes", "transpose", "delta", "shuffle", "packbits", "sharding_indexed"),
    *("default", "regular", "v2"),
}
"""Names of the codecs that are allowed. Others, such as pickle, can run code."""


def _import_zarr() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise MissingExtraError("zarr folders need zarr: pip install 'jotlight[zarr]'") from error
    return zarr


def _is_zarr(path: Path) -> bool:
    return any((path / name).is_file() for name in _METADATA_FILES)


def open_zarr(path: Path, options: OpenOptions) -> Capture:
    """Return the capture in an array of a zarr folder."""
    zarr = _import_zarr()
    if not path.is_dir():
        raise FileNotFoundError(f"there is no folder {path}")
    folders = {str(folder.relative_to(path)): folder for folder in _list_arrays(path)}
    if options.key in folders:
        # Other arrays are opened only if they may be maps of the sensor.
        folders = {name: folders[name] for name in (options.key, *MAPS) if name in folders}
    arrays = {name: _check_array(zarr, folder) for name, folder in folders.items()}
    return open_stored_array(arrays, Provenance("zarr", path.name), options)


def _list_arrays(path: Path) -> list[Path]:
    """Return the folders of all arrays. The chunks of an array are not listed."""
    found: list[Path] = []
    waiting = [path]
    while waiting and len(found) < _MAX_ARRAYS:
        folder = waiting.pop()
        metadata = [
            _read_metadata(folder / name) for name in _METADATA_FILES if (folder / name).is_file()
        ]
        if any("shape" in each for each in metadata):
            found.append(folder)
        elif metadata:
            waiting += [inner for inner in folder.iterdir() if inner.is_dir()]
    if not found:
        raise ValueError(f"{path}: expected a zarr folder with an array in it")
    return sorted(found)


def _read_metadata(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _MAX_METADATA_BYTES:
            raise ValueError("it is too long")
        metadata = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(metadata, dict):
            raise ValueError("expected an object")
        if "shape" in metadata:
            _check_codecs(metadata)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: the description of the array is damaged ({error})") from error
    return metadata


def _check_codecs(metadata: Any) -> None:
    """Raise ValueError if the metadata name a codec, at any depth, that is not known to be safe."""
    if isinstance(metadata, dict):
        for name, value in metadata.items():
            if name in ("name", "id") and not (isinstance(value, str) and value in _SAFE_CODECS):
                raise ValueError(f"codecs: expected only known safe codecs, got {value!r}")
            if name != "attributes":
                _check_codecs(value)
    if isinstance(metadata, list):
        for value in metadata:
            _check_codecs(value)


def _check_array(zarr: Any, folder: Path) -> StoredArray:
    try:
        array = zarr.open_array(str(folder), mode="r")
        shape, dtype, chunks = tuple(array.shape), np.dtype(array.dtype), tuple(array.chunks)
        label = array.attrs.get(ATTRIBUTE)
    except Exception as error:  # the library raises many exceptions for damaged folders
        raise ValueError(f"{folder}: the array is damaged ({error})") from error
    if dtype.kind not in "biuf" or not shape or min(shape) < 0:
        raise ValueError(f"{folder}: expected an array of numbers, got {dtype} of shape {shape}")
    folder_bytes = sum(
        (Path(place) / name).stat().st_size for place, _, names in os.walk(folder) for name in names
    )
    check_claimed_size(str(folder), math.prod(shape) * dtype.itemsize, folder_bytes)
    if math.prod(chunks) * dtype.itemsize > _MAX_CHUNK_BYTES:
        raise ValueError(f"{folder}: has chunks of more than {_MAX_CHUNK_BYTES} bytes")

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        try:
            return np.asarray(array[start:stop])
        except Exception as error:
            raise ValueError(f"{folder}: a chunk is damaged ({error})") from error

    return StoredArray(Frames(shape, read, dtype), label if isinstance(label, str) else None)


def _write_bits(bits: Bits, path: Path) -> None:
    """Write bits as an array, or as a group of arrays if the sensor has maps."""
    zarr = _import_zarr()
    maps = bits.sensor.maps() if bits.sensor is not None else {}
    shape = bits.packed.shape
    chunk_frames = max(1, min(shape[0], _WRITTEN_CHUNK_BYTES // math.prod(shape[1:])))
    with atomic_folder(path) as folder:
        if maps:
            zarr.open_group(str(folder), mode="w")
            for name, map_ in maps.items():
                inner = zarr.open_array(
                    str(folder / name), mode="w", shape=map_.shape, dtype=map_.dtype
                )
                inner[...] = map_
        array = zarr.open_array(
            str(folder / "bits" if maps else folder),
            mode="w",
            shape=shape,
            chunks=(chunk_frames, *shape[1:]),
            dtype=np.uint8,
        )
        # Each write covers complete chunks, so no chunk is written twice.
        for start in range(0, shape[0], chunk_frames):
            place = slice(start, min(start + chunk_frames, shape[0]))
            array[place] = np.asarray(bits.packed[place, ...])
        array.attrs[ATTRIBUTE] = bits_label(bits)


def _write_counts(counts: Counts, path: Path, label: str | None) -> None:
    zarr = _import_zarr()
    with atomic_folder(path) as folder:
        array = zarr.open_array(
            str(folder), mode="w", shape=counts.shape, chunks=counts.shape, dtype=np.int32
        )
        array[...] = counts
        if label is not None:
            array.attrs[ATTRIBUTE] = label


ZARR = Format(
    "zarr",
    "an array in a zarr folder",
    open=open_zarr,
    matches=_is_zarr,
    has_keys=True,
    writer=Writer(
        bits=_write_bits,
        counts=_write_counts,
        extensions=(".zarr",),
        folder=True,
        keeps_sensor=True,
        keeps_label=True,
    ),
)
