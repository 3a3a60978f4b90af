"""HDF5: a data set of packed bits, of booleans, or of counts. Requires the extra `hdf5`."""

import contextlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import Counts
from jotlight.errors import MissingExtraError, warn
from jotlight.files import atomic_write
from jotlight.formats.capture import Capture
from jotlight.formats.format import Format, OpenOptions, Writer
from jotlight.formats.labeled import ATTRIBUTE, StoredArray, bits_label, open_stored_array
from jotlight.formats.limits import check_claimed_size
from jotlight.formats.magic import has_type
from jotlight.output_files import open_output
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, read_in_chunks
from jotlight.sensing.provenance import Provenance

_MAX_DATA_SETS = 1000
"""Maximum number of data sets that are listed for a file."""

_MAX_CHUNK_BYTES = 1 << 28
"""Maximum size of a chunk in bytes. The library decompresses a chunk as a whole."""

_WRITTEN_CHUNK_BYTES = 1 << 20


def _import_h5py() -> Any:
    try:
        import h5py
    except ImportError as error:
        raise MissingExtraError(
            "HDF5 and MATLAB 7.3 files need h5py: pip install 'jotlight[hdf5]'"
        ) from error
    return h5py


@contextlib.contextmanager
def _naming_file(path: Path) -> Iterator[None]:
    """Raise a ValueError that names the file for every error of the HDF5 library."""
    try:
        yield
    except (MissingExtraError, FileNotFoundError, PermissionError):
        raise
    except ValueError as error:
        if str(path) in str(error):
            raise
        raise ValueError(f"{path}: the HDF5 file is damaged ({error})") from error
    except Exception as error:  # the library raises many exceptions for damaged files
        raise ValueError(f"{path}: the HDF5 file is damaged ({error})") from error


def list_data_sets(path: Path) -> dict[str, StoredArray]:
    """Return the numeric data sets of an HDF5 file by name. They are read when needed.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When the file is damaged, refers to other files, or claims more than it can hold.
    MissingExtraError
        When h5py is not installed.
    """
    h5py = _import_h5py()
    arrays: dict[str, StoredArray] = {}

    def visit(name: str, item: Any) -> bool | None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "biuf" and item.ndim > 0:
            arrays[name] = _check_data_set(path, item)
        return True if len(arrays) >= _MAX_DATA_SETS else None

    with _naming_file(path):
        # visititems follows no links, so a file cannot lead to another file.
        h5py.File(path, "r").visititems(visit)
    return arrays


def _check_data_set(path: Path, item: Any) -> StoredArray:
    if item.external or item.is_virtual:
        raise ValueError(f"{path}: {item.name} is in other files, which are not opened")
    size = math.prod(item.shape) * item.dtype.itemsize
    check_claimed_size(f"{path}: {item.name}", size, path.stat().st_size)
    if item.chunks and math.prod(item.chunks) * item.dtype.itemsize > _MAX_CHUNK_BYTES:
        raise ValueError(f"{path}: {item.name} has chunks of more than {_MAX_CHUNK_BYTES} bytes")
    label = _read_label(path, item)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        with _naming_file(path):
            return np.asarray(item[start:stop])

    return StoredArray(Frames(item.shape, read, item.dtype), label)


def _read_label(path: Path, item: Any) -> str | None:
    """Return the label of a data set, which must be a string of fixed length.

    Strings of variable length are stored in a heap. Such strings are not read, because reading a
    damaged heap hangs the library.
    """
    with _naming_file(path):
        if ATTRIBUTE not in item.attrs:
            return None
        if item.attrs.get_id(ATTRIBUTE).dtype.kind != "S":
            warn(
                f"{path}: the attribute jotlight of {item.name} is not a string of fixed length, "
                "so it is ignored"
            )
            return None
        return bytes(item.attrs[ATTRIBUTE]).decode()


def open_hdf5(path: Path, options: OpenOptions) -> Capture:
    """Return the capture in a data set of an HDF5 file."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    return open_stored_array(list_data_sets(path), Provenance("hdf5", path.name), options)


@contextlib.contextmanager
def _create(path: Path) -> Iterator[tuple[Any, Callable[[], None]]]:
    """Yield a new HDF5 file, and a function that raises the error of the first failed write.

    When a write fails, the library keeps the data, and writing them again as the process ends
    crashes it. So the library learns nothing of failed writes.
    """
    h5py = _import_h5py()
    with (
        atomic_write(path) as temporary,
        open_output(temporary, postpone_errors=True) as output,
        h5py.File(output, "w") as file,
    ):
        yield file, output.check


def _write_bits(bits: Bits, path: Path) -> None:
    shape = bits.packed.shape
    frame_bytes = math.prod(shape[1:])
    chunks = (max(1, min(shape[0], _WRITTEN_CHUNK_BYTES // frame_bytes)), *shape[1:])
    with _create(path) as (file, check):
        cube = file.create_dataset(
            "bits", shape, np.uint8, chunks=chunks, compression="gzip", compression_opts=1
        )
        for place, part in read_in_chunks(bits.packed):
            cube[place] = part
            check()
        cube.attrs[ATTRIBUTE] = np.bytes_(bits_label(bits).encode())
        for name, map_ in (bits.sensor.maps() if bits.sensor else {}).items():
            file.create_dataset(name, data=map_)


def _write_counts(counts: Counts, path: Path, label: str | None) -> None:
    with _create(path) as (file, _):
        image = file.create_dataset("counts", data=counts)
        if label is not None:
            image.attrs[ATTRIBUTE] = np.bytes_(label.encode())


HDF5 = Format(
    "hdf5",
    "an array in an HDF5 file",
    open=open_hdf5,
    matches=lambda path: has_type(path, "hdf5"),
    extensions=(".h5", ".hdf5"),
    has_keys=True,
    writer=Writer(
        bits=_write_bits,
        counts=_write_counts,
        extensions=(".h5", ".hdf5"),
        keeps_sensor=True,
        keeps_label=True,
    ),
)
