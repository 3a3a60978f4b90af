"""zarr folders: an array of packed bits, of bool, or of counts. Needs the extra `zarr`."""

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import MissingExtraError
from jotlight.formats.capture import Capture
from jotlight.formats.labeled import StoredArray, label, open_stored_array
from jotlight.formats.limits import check_claimed_size
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames
from jotlight.sensing.maps import MAPS
from jotlight.sensing.provenance import Provenance

DESCRIPTIONS = ("zarr.json", ".zarray", ".zgroup")

_MOST_ARRAYS = 1000
_MOST_JSON = 1 << 22
_MOST_CHUNK = 1 << 28
_CODECS = {
    *("blosc", "bz2", "gzip", "lz4", "lzma", "zlib", "zstd", "crc32", "crc32c", "adler32"),
    *("bytes", "transpose", "delta", "shuffle", "packbits", "sharding_indexed"),
    *("default", "regular", "v2"),
}
"""What may unpack chunks; others, such as pickle, can run code."""


def _zarr() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise MissingExtraError("zarr folders need zarr: pip install 'jotlight[zarr]'") from error
    return zarr


def open_zarr(
    path: Path,
    *,
    key: str | None = None,
    counts: bool | None = None,
    width: int | None = None,
    sure: bool = False,
) -> Capture:
    """Open the array of a folder, by name where it has several."""
    zarr = _zarr()
    if not path.is_dir():
        raise FileNotFoundError(f"there is no folder {path}")
    folders = {str(folder.relative_to(path)): folder for folder in _arrays(path)}
    if key in folders:
        # Of the others only those that may belong to it.
        folders = {name: folders[name] for name in (key, *MAPS) if name in folders}
    found = {name: _item(zarr, folder) for name, folder in folders.items()}
    provenance = Provenance("zarr", path.name)
    return open_stored_array(found, provenance, key=key, counts=counts, width=width, sure=sure)


def _arrays(path: Path) -> list[Path]:
    """The folders of arrays, found without looking at their chunks."""
    found: list[Path] = []
    waiting = [path]
    while waiting and len(found) < _MOST_ARRAYS:
        folder = waiting.pop()
        told = [_described(folder / name) for name in DESCRIPTIONS if (folder / name).is_file()]
        if any("shape" in one for one in told):
            found.append(folder)
        elif told:
            waiting += [inner for inner in folder.iterdir() if inner.is_dir()]
    if not found:
        raise ValueError(f"{path}: expected a folder of zarr with an array in it")
    return sorted(found)


def _described(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _MOST_JSON:
            raise ValueError("it is too long")
        told = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(told, dict):
            raise ValueError("expected an object")
        if "shape" in told:
            _check_codecs(told)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: the description of the array is damaged ({error})") from error
    return told


def _check_codecs(told: Any) -> None:
    """Raise ValueError for a codec that is not known to be harmless, at any depth."""
    if isinstance(told, dict):
        for name, value in told.items():
            if name in ("name", "id") and not (isinstance(value, str) and value in _CODECS):
                raise ValueError(f"codecs: expected well-known ones, got {value!r}, not used")
            if name != "attributes":
                _check_codecs(value)
    if isinstance(told, list):
        for value in told:
            _check_codecs(value)


def _item(zarr: Any, folder: Path) -> StoredArray:
    try:
        array = zarr.open_array(str(folder), mode="r")
        shape, dtype, chunks = tuple(array.shape), np.dtype(array.dtype), tuple(array.chunks)
        told = array.attrs.get("jotlight")
    except Exception as error:  # anything: what is damaged fails in many ways
        raise ValueError(f"{folder}: the array is damaged ({error})") from error
    if dtype.kind not in "biuf" or not shape or min(shape) < 0:
        raise ValueError(f"{folder}: expected an array of numbers, got {dtype} of shape {shape}")
    there = sum(
        (Path(place) / name).stat().st_size for place, _, names in os.walk(folder) for name in names
    )
    check_claimed_size(str(folder), math.prod(shape) * dtype.itemsize, there)
    if math.prod(chunks) * dtype.itemsize > _MOST_CHUNK:
        raise ValueError(f"{folder}: has chunks of more than {_MOST_CHUNK} bytes")

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        try:
            return np.asarray(array[start:stop])
        except Exception as error:
            raise ValueError(f"{folder}: a chunk is damaged ({error})") from error

    return StoredArray(Frames(shape, read, dtype), told if isinstance(told, str) else None)


def write_zarr(folder: Path, data: Bits | npt.NDArray[np.int32], told: str | None = None) -> None:
    """Write packed bits, or an image of counts and its label, into an empty folder.

    A sensor's maps stand beside the bits in a group.
    """
    zarr = _zarr()
    bits = data if isinstance(data, Bits) else None
    maps = bits.sensor.maps() if bits is not None and bits.sensor is not None else {}
    if maps:
        zarr.open_group(str(folder), mode="w")
        for name, map_ in maps.items():
            inner = zarr.open_array(
                str(folder / name), mode="w", shape=map_.shape, dtype=map_.dtype
            )
            inner[...] = map_
        folder = folder / "bits"
    shape = data.shape if bits is None else bits.packed.shape
    each = math.prod(shape[1:])
    chunks = (max(1, min(shape[0], (1 << 23) // each)), *shape[1:])
    array = zarr.open_array(
        str(folder),
        mode="w",
        shape=shape,
        chunks=shape if bits is None else chunks,
        dtype=np.int32 if bits is None else np.uint8,
    )
    if bits is None:
        array[...] = data
        if told is not None:
            array.attrs["jotlight"] = told
        return
    # Whole chunks at a time, so that none is written twice.
    for start in range(0, shape[0], chunks[0]):
        place = slice(start, min(start + chunks[0], shape[0]))
        array[place] = np.asarray(bits.packed[place, ...])
    array.attrs["jotlight"] = label(bits)
