"""HDF5: a data set of packed bits, of bool, or of counts. Needs the extra `hdf5`."""

import contextlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import MissingExtraError, warn
from jotlight.formats.capture import Capture
from jotlight.formats.labeled import StoredArray, label, open_stored_array
from jotlight.formats.limits import check_claimed_size
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, read_in_chunks
from jotlight.sensing.provenance import Provenance

_MOST_SETS = 1000
_MOST_CHUNK = 1 << 28
"""Bytes of a chunk, which is unpacked whole, at most."""


def _h5py() -> Any:
    try:
        import h5py
    except ImportError as error:
        raise MissingExtraError(
            "HDF5 and MATLAB 7.3 files need h5py: pip install 'jotlight[hdf5]'"
        ) from error
    return h5py


@contextlib.contextmanager
def _said(path: Path) -> Iterator[None]:
    """What the HDF5 library says of a damaged file, in our words."""
    try:
        yield
    except (MissingExtraError, FileNotFoundError, PermissionError):
        raise
    except ValueError as error:
        if str(path) in str(error):
            raise
        raise ValueError(f"{path}: the HDF5 file is damaged ({error})") from error
    except Exception as error:  # anything: the library has many ways to fail
        raise ValueError(f"{path}: the HDF5 file is damaged ({error})") from error


def open_file(path: Path) -> dict[str, StoredArray]:
    """The data sets of numbers in a file by name, read when asked for."""
    h5py = _h5py()
    found: dict[str, StoredArray] = {}

    def visit(name: str, item: Any) -> bool | None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "biuf" and item.ndim > 0:
            found[name] = _item(path, item)
        return True if len(found) >= _MOST_SETS else None

    with _said(path):
        # Links are not followed, and so no file leads to another.
        h5py.File(path, "r").visititems(visit)
    return found


def _item(path: Path, item: Any) -> StoredArray:
    if item.external or item.is_virtual:
        raise ValueError(f"{path}: {item.name} is in other files, which are not opened")
    size = math.prod(item.shape) * item.dtype.itemsize
    check_claimed_size(f"{path}: {item.name}", size, path.stat().st_size)
    if item.chunks and math.prod(item.chunks) * item.dtype.itemsize > _MOST_CHUNK:
        raise ValueError(f"{path}: {item.name} has chunks of more than {_MOST_CHUNK} bytes")
    told = _label_of(path, item)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        with _said(path):
            return np.asarray(item[start:stop])

    return StoredArray(Frames(item.shape, read, item.dtype), told)


def _label_of(path: Path, item: Any) -> str | None:
    """What jotlight wrote beside an array.

    In a string of fixed length: those of variable length lie in a heap, in which the library looks
    for ever where it is damaged. So none is read.
    """
    with _said(path):
        if "jotlight" not in item.attrs:
            return None
        if item.attrs.get_id("jotlight").dtype.kind != "S":
            warn(
                f"{path}: the attribute jotlight of {item.name} is no text of fixed length, and "
                "only those are read"
            )
            return None
        return bytes(item.attrs["jotlight"]).decode()


def open_hdf5(
    path: Path,
    *,
    key: str | None = None,
    counts: bool | None = None,
    width: int | None = None,
    sure: bool = False,
) -> Capture:
    """Open the data set of a file, by name where it has several."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    found = open_file(path)
    provenance = Provenance("hdf5", path.name)
    return open_stored_array(found, provenance, key=key, counts=counts, width=width, sure=sure)


def write_hdf5(path: Path, data: Bits | npt.NDArray[np.int32], told: str | None = None) -> None:
    """Write packed bits and the sensor's maps, or an image of counts and its label."""
    h5py = _h5py()
    with h5py.File(path, "w") as file:
        if isinstance(data, Bits):
            shape = data.packed.shape
            each = math.prod(shape[1:])
            chunks = (max(1, min(shape[0], (1 << 20) // each)), *shape[1:])
            cube = file.create_dataset(
                "bits", shape, np.uint8, chunks=chunks, compression="gzip", compression_opts=1
            )
            for place, part in read_in_chunks(data.packed):
                cube[place] = part
            cube.attrs["jotlight"] = np.bytes_(label(data).encode())
            for name, map_ in (data.sensor.maps() if data.sensor else {}).items():
                file.create_dataset(name, data=map_)
        else:
            image = file.create_dataset("counts", data=data)
            if told is not None:
                image.attrs["jotlight"] = np.bytes_(told.encode())
