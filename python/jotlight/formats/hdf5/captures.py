"""HDF5: a data set of packed bits, of booleans, or of counts. Requires the extra `hdf5`."""

import contextlib
import functools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Counts
from jotlight.errors import needs_module, warn
from jotlight.files import atomic_write
from jotlight.formats.capture import Capture
from jotlight.formats.files.checksums import file_checksum
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.limits import (
    check_frame_size,
    check_missing_chunks,
)
from jotlight.formats.files.magic import has_type
from jotlight.formats.files.remote_files import open_binary, raise_failure, remote_file
from jotlight.formats.format import Format, Writer
from jotlight.formats.frames.blocks import read_by_blocks
from jotlight.formats.frames.labeled import (
    ATTRIBUTE,
    ListedArray,
    StoredArray,
    bits_label,
    open_stored_array,
)
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.hdf5.chunks import write_chunks
from jotlight.formats.hdf5.isolated import IsolatedLibrary
from jotlight.formats.hdf5.library import DataSet, Hdf5Library
from jotlight.interrupts import hold_signals
from jotlight.output_files import open_output
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.provenance import Provenance

_MAX_CHUNK_BYTES = 1 << 28
"""Maximum size of a chunk in bytes. The library decompresses a chunk as a whole."""

_MAX_MISSING = 10_000
"""Maximum number of missing chunks for each existing one. The library fills ten times as many in
the time that zarr takes."""

_WRITTEN_CHUNK_BYTES = 1 << 20
"""Maximum size in bytes of the chunks that jotlight writes, unless one frame has more."""

_USER_BLOCK_BYTES = 512
"""Size of the part before the HDF5 data, which HDF5 leaves to applications."""

_USER_BLOCK = (
    "jotlight wrote this HDF5 file. This text holds the SHA-256 of all bytes after its 512 bytes, "
    "as `tail -c +513 FILE | sha256sum` prints it:\n{}\n"
    "If you changed the file, overwrite this text with zeros or remove it with h5repack.\n"
)
"""Text before the HDF5 data, in which the checksum is inserted."""

_MARKS = (b"jotlight wrote", b"SHA-256")
"""Parts of this text that identify it. One flipped bit cannot damage both."""

_REFUSALS = {
    "external": "an external data set, whose values are in other files, and jotlight opens no "
    "other file; copy its values into an ordinary data set",
    "virtual": "a virtual data set, whose parts may be in other files, and jotlight opens no other "
    "file; copy its values into an ordinary data set",
    "compound": "a table, such as a list of events; jotlight reads arrays of numbers, so convert "
    "it to frames of bits (T, H, W), or to counts (H, W)",
}
"""Why data sets of each layout are not read, and what to do instead."""

_FILTERS = {4: "SZIP", 32001: "Blosc", 32004: "LZ4", 32008: "Bitshuffle", 32015: "Zstandard"}
"""Names of filters by their registered numbers."""

_IS_WRITTEN = "another program is writing it; open it again when it is complete"

_MARKED = "already open for"
"""A part of the library's error for a file that is marked as being written."""

_IS_MARKED = (
    "if no program writes it any more, the one that did has crashed: copy the file, and remove its "
    "mark by `h5clear --status COPY`"
)


class Library(Protocol):
    """The calls of the HDF5 library that jotlight needs, in this process or in a child process."""

    def list_data_sets(self, path: str, attribute: str) -> list[DataSet]:
        """Return the numeric data sets of a file, each with its label in an attribute."""

    def read(self, data_set: DataSet, start: int, stop: int) -> npt.NDArray[Any]:
        """Return a part of a data set, along its first dimension."""


def load_library(isolate: bool) -> Library:
    """Return the HDF5 library, in a child process if `isolate` is True.

    Use one library for all files of a capture, so that they share the child process.
    """
    return IsolatedLibrary() if isolate else Hdf5Library(_opened)


def _opened(path: str) -> Any:
    """Return what h5py opens: the path, or a file object that reads ranges from a URL."""
    return path if remote_file(Path(path)) is None else open_binary(Path(path))


@contextlib.contextmanager
def _naming_file(path: Path) -> Iterator[None]:
    """Raise a ValueError that names the file for every error of the HDF5 library."""
    try:
        with needs_module(
            "h5py", "HDF5 and MATLAB 7.3 files need h5py: pip install 'jotlight[hdf5]'"
        ):
            yield
    except (ImportError, FileNotFoundError, PermissionError, ChildProcessError):
        raise
    except BlockingIOError as error:
        raise OSError(f"{path}: {_IS_WRITTEN}") from error
    except Exception as error:  # the library raises many exceptions for damaged files
        raise_failure([path])
        if _MARKED in str(error):
            raise OSError(f"{path}: {_IS_WRITTEN}; {_IS_MARKED}") from error
        if str(path) in str(error) and isinstance(error, ValueError):
            raise
        raise ValueError(f"{path}: the HDF5 file is damaged ({error})") from error


@contextlib.contextmanager
def _naming_filter(path: Path, data_set: DataSet) -> Iterator[None]:
    """If the library lacks a filter, raise a ValueError that names it in place of any error.

    Without an error, nothing is raised: chunks may be stored without an optional filter.
    """
    try:
        yield
    except Exception as error:
        if not data_set.missing_filters:
            raise
        number = data_set.missing_filters[0]
        raise ValueError(
            f"{path}: {data_set.name} is stored with the filter {_FILTERS.get(number, number)}, "
            "which HDF5 cannot decode without a package that adds it: pip install hdf5plugin"
        ) from error


def list_data_sets(path: Path, library: Library) -> dict[str, ListedArray]:
    """Return the numeric data sets of an HDF5 file by name.

    Opening one raises ValueError when its data are or may be in other files, or when it claims more
    than the file can hold.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When the file is damaged.
    MissingExtraError
        When h5py is not installed.
    """
    file = FileReader(path)
    with _naming_file(path):
        found = library.list_data_sets(str(path), ATTRIBUTE)
    return {
        each.name: ListedArray(
            each.label,
            functools.partial(_open_data_set, file, each, library),
            None if each.layout == "ordinary" else each.layout,
        )
        for each in found
    }


def _open_data_set(file: FileReader, data_set: DataSet, library: Library) -> StoredArray:
    path = file.path
    if data_set.layout != "ordinary":
        raise ValueError(f"{path}: {data_set.name} is {_REFUSALS[data_set.layout]}")
    dtype = np.dtype(data_set.dtype)
    shape, name = data_set.shape, f"{path}: {data_set.name}"
    frame_bytes = math.prod(shape[1:] if len(shape) > 2 else shape) * dtype.itemsize
    check_frame_size(name, frame_bytes, file.size)
    kind = "chunks" if data_set.chunk_bytes else "frames"
    reason = f"are read as the fill value; HDF5 omits {kind} that were not written"
    total, missing = data_set.chunks, data_set.missing_chunks
    check_missing_chunks(name, total - missing, total, _MAX_MISSING, kind=kind, reason=reason)
    if data_set.chunk_bytes > _MAX_CHUNK_BYTES:
        raise ValueError(
            f"{path}: {data_set.name} has chunks of more than {_MAX_CHUNK_BYTES} bytes"
        )
    if data_set.label_ignored:
        warn(
            f"{path}: the attribute {ATTRIBUTE} of {data_set.name} is not a string of fixed "
            "length, so it is ignored"
        )

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        with file.expect_unchanged(), _naming_file(path), _naming_filter(path, data_set):
            return np.asarray(library.read(data_set, int(start), int(stop)))

    frames = Frames(shape, read, dtype)
    blocks = read_by_blocks(frames, data_set.chunk_frames, _MAX_CHUNK_BYTES)
    return StoredArray(blocks, file.size)


def open_hdf5(path: Path, options: ReadingOptions) -> Capture:
    """Return the capture in a data set of an HDF5 file."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    arrays = list_data_sets(path, load_library(options.isolate))
    return open_stored_array(arrays, Provenance("hdf5", path.name), options)


def _verify(path: Path) -> int:
    """Return 1 if a file matches its SHA-256, or 0 if jotlight did not write the file."""
    with open_binary(path) as file:
        start = file.read(_USER_BLOCK_BYTES)
    if not any(mark in start for mark in _MARKS):
        return 0
    if start != _user_block(path):
        raise ValueError(
            f"{path}: is damaged or was changed: its SHA-256 is not the one that was stored when "
            "jotlight wrote it; restore it from a copy, or if you changed it, overwrite its first "
            f"{_USER_BLOCK_BYTES} bytes with zeros"
        )
    return 1


def _user_block(path: Path) -> bytes:
    """Return the text that belongs before the HDF5 data in a file."""
    text = _USER_BLOCK.format(file_checksum(path, _USER_BLOCK_BYTES))
    return text.encode().ljust(_USER_BLOCK_BYTES)


@contextlib.contextmanager
def _create(path: Path) -> Iterator[tuple[Any, Callable[[], None]]]:
    """Yield a new HDF5 file, and a function that raises the error of the first failed write.

    After a failed write, the library keeps the data, tries again when the process ends, and
    crashes. So the file hides failed writes from the library. For the same reason, Ctrl-C waits
    until the function is called.
    """
    with _naming_file(path):
        import h5py
    with atomic_write(path) as temporary, open_output(temporary, postpone_errors=True) as output:
        with hold_signals() as raise_held:

            def check() -> None:
                output.check()
                raise_held()

            # The formats of HDF5 1.10 have checksums for metadata, and other software reads them.
            with h5py.File(
                output, "w", libver=("v110", "v110"), userblock_size=_USER_BLOCK_BYTES
            ) as file:
                yield file, check
        output.flush()
        output.check()
        block = _user_block(temporary)
        output.seek(0)
        output.write(block)


def _write_bits(bits: Bits, path: Path) -> None:
    shape = bits.packed.shape
    frame_bytes = math.prod(shape[1:])
    chunks = (max(1, min(shape[0], _WRITTEN_CHUNK_BYTES // frame_bytes)), *shape[1:])
    with _create(path) as (file, check):
        cube = file.create_dataset(
            "bits",
            shape,
            np.uint8,
            chunks=chunks,
            compression="gzip",
            compression_opts=1,
            fletcher32=True,
        )
        for _ in write_chunks(cube, bits.packed):
            check()
        cube.attrs[ATTRIBUTE] = np.bytes_(bits_label(bits).encode())
        for name, map_ in (bits.sensor.maps() if bits.sensor else {}).items():
            file.create_dataset(name, data=map_, fletcher32=True)


def _write_counts(counts: Counts, path: Path, label: str | None) -> None:
    with _create(path) as (file, _):
        image = file.create_dataset("counts", data=counts, fletcher32=True)
        if label is not None:
            image.attrs[ATTRIBUTE] = np.bytes_(label.encode())


HDF5 = Format(
    "hdf5",
    "an array in an HDF5 file",
    open=open_hdf5,
    matches=lambda path: has_type(path, "hdf5"),
    extensions=(".h5", ".hdf5"),
    other_extensions=(".hdf", ".he5", ".nxs"),
    has_keys=True,
    verify=_verify,
    writer=Writer(
        bits=_write_bits,
        counts=_write_counts,
        extensions=(".h5", ".hdf5"),
        keeps_sensor=True,
        keeps_label=True,
    ),
)
