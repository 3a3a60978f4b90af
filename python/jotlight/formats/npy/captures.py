"""NumPy's own formats: `.npy`, compressed `.npy.gz`, and `.npz` archives.

An array is a photon cube (packed bits), frames of booleans, or counts.
"""

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Counts
from jotlight.files import atomic_write
from jotlight.formats.capture import Capture
from jotlight.formats.files.magic import has_type
from jotlight.formats.files.remote_files import remote_file
from jotlight.formats.format import Format, Writer
from jotlight.formats.frames.count_stacks import as_count_stack, stack_of_readings
from jotlight.formats.frames.labels import AS_STATED, BITS, COUNTS, READINGS, make_readings_label
from jotlight.formats.frames.packing import pack_lazily
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.npy.archives import finish_npz, read_npz_label, stream_npz, verify_npz
from jotlight.formats.npy.arrays import open_npy_array, write_npy
from jotlight.formats.npy.compressed import stream_npy_gz, write_npy_gz
from jotlight.formats.npy.cube import describe_bits, open_cube
from jotlight.formats.npy.description import (
    Description,
    check_data,
    check_shape,
    find_description,
    read_sensor,
    verify_cube,
    write_described,
)
from jotlight.formats.raw import EXTENSIONS as RAW_EXTENSIONS
from jotlight.output_files import open_output
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import warn_about_axes
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.parameters.provenance import Provenance

_WriteArray = Callable[[IO[bytes], npt.NDArray[Any] | Frames], None]
"""A function that writes an array, `write_npy` or `write_npy_gz`."""


def open_npy(path: Path, options: ReadingOptions) -> Capture:
    """Return the capture in a `.npy` file."""
    description = find_description(path)
    # At a URL, comparing the checksum would read the whole file. Conversions do.
    is_local = remote_file(path) is None
    if is_local and description is not None and description.format in (COUNTS, READINGS):
        check_data(description, path)
    return _open_array(
        open_npy_array(path), path, NPY.name, options, options.takes_counts, description
    )


def open_npy_gz(path: Path, options: ReadingOptions) -> Capture:
    """Return the capture in a `.npy.gz` file, which is decompressed as it is read."""
    description = find_description(path)
    verified = description is not None and check_data(description, path)
    frames = stream_npy_gz(path, verified=verified)
    return _open_array(frames, path, NPY_GZ.name, options, options.takes_counts, description)


def open_npz(path: Path, options: ReadingOptions) -> Capture:
    """Return the capture in one array of a `.npz` archive: counts, unless they are booleans."""
    verified = remote_file(path) is None and verify_npz(path) > 0
    array, label = stream_npz(path, options.key, verified=verified), read_npz_label(path)
    counts = options.takes_counts
    if counts is None and array.dtype != np.bool_:
        counts = True
    return _open_array(array, path, NPZ.name, options, counts, label=label)


def _open_array(
    array: npt.NDArray[Any] | Frames,
    path: Path,
    name: str,
    options: ReadingOptions,
    counts: bool | None,
    description: Description | None = None,
    label: str | None = None,
) -> Capture:
    """Return the bits or counts in an array. If `counts` is None, its type and shape decide."""
    if 0 in array.shape:
        raise ValueError(
            f"{path}: expected an array with numbers in it, got shape {array.shape}, with a "
            "dimension of 0"
        )
    dimensions = len(array.shape)
    is_cube = array.dtype == np.uint8 and dimensions in (3, 4)
    if description is not None and description.format == READINGS:
        check_shape(description, path, array.shape)
        return _open_readings(array, path, name, description)
    if description is not None:
        check_shape(description, path, array.shape)
        if description.format == COUNTS:
            label, counts = description.text, counts is not False
        if (description.format == BITS) != (is_cube and not counts):
            content = "packed bits" if is_cube and not counts else f"an array of {array.dtype}"
            raise ValueError(
                f"{description.path}: is the description of {description.format}, but {path.name} "
                f"is read as {content}; {AS_STATED}, or move the description away"
            )
    if array.dtype == np.bool_ and dimensions in (3, 4) and not counts:
        provenance = Provenance(name, path.name, ("frames of bool, one bit each",))
        warn_about_axes(path.name, array.shape)
        return Bits(pack_lazily(array, path.name), array.shape[2], provenance=provenance)
    if counts is False and not is_cube:
        raise ValueError(
            f"{path}: expected packed bits, uint8 of shape (T, H, W/8) or (T, H, W/8, C), "
            f"got {array.dtype} of shape {array.shape}"
        )
    if not counts and is_cube:
        stated = counts is False or options.is_packed or options.packed_width is not None
        if description is None and not stated:
            _refuse_photograph(array.shape, path)
        return open_cube(
            array, path, name, options.packed_width, description, check=not options.is_packed
        )
    return as_count_stack(array, Provenance(name, path.name), label, floats=options.takes_floats)


def _open_readings(
    array: npt.NDArray[Any] | Frames, path: Path, name: str, description: Description
) -> Capture:
    """Return readings of several bits with the sensor of their description."""
    sensor, origin = read_sensor(description)
    if sensor is None:
        raise ValueError(f"{description.path}: expected the sensor of the readings, got none")
    provenance = Provenance(name, path.name).converted_from(origin)
    return stack_of_readings(array, provenance, sensor)


def _refuse_photograph(shape: tuple[int, ...], path: Path) -> None:
    """Raise ValueError for an array of three dimensions that may be a photograph in color.

    As packed bits, it would have at most 32 jots in a row. Packed bits with color channels have
    four dimensions.
    """
    if len(shape) == 3 and shape[2] in (3, 4):
        raise ValueError(
            f"{path}: uint8 of shape {shape} looks like a color photograph, of which `jotlight "
            f"simulate` makes a capture; if it is {shape[0]} frames of packed bits, pass "
            "counts=False (--bits); if it is an image of counts, counts=True (--counts)"
        )


def _is_npy_gz(path: Path) -> bool:
    return has_type(path, "gzip") and not path.name.lower().endswith(RAW_EXTENSIONS)


def _write_bits(write: _WriteArray, bits: Bits, path: Path) -> None:
    with describe_bits(bits, path) as file:
        write(file, bits.packed)


def _write_counts(write: _WriteArray, counts: Counts, path: Path, label: str) -> None:
    content = {**json.loads(label), "shape": list(counts.shape)}
    with write_described(path, content, {}) as file:
        write(file, counts)


def _write_npy_readings(readings: Readings, path: Path) -> None:
    kind = np.uint8 if readings.sensor.bit_depth <= 8 else np.uint16
    content = {
        **make_readings_label(readings.sensor, readings.provenance),
        "shape": list(readings.shape),
    }
    frames = Frames(
        readings.shape, lambda start, stop: readings.read(start, stop).astype(kind), kind
    )
    with write_described(path, content, readings.sensor.maps()) as file:
        write_npy(file, frames)


def _write_npz_counts(counts: Counts, path: Path, label: str) -> None:
    with atomic_write(path) as temporary, open_output(temporary) as file:
        np.savez_compressed(file, counts=counts)
        finish_npz(file, label)


NPY = Format(
    "npy",
    "an array of NumPy: a photon cube or counts",
    open=open_npy,
    matches=lambda path: has_type(path, "npy"),
    extensions=(".npy",),
    writer=Writer(
        bits=functools.partial(_write_bits, write_npy),
        counts=functools.partial(_write_counts, write_npy),
        readings=_write_npy_readings,
        extensions=(".npy",),
        plain=True,
        keeps_sensor=True,
        keeps_label=True,
    ),
    verify=verify_cube,
)

NPY_GZ = Format(
    "npy.gz",
    "the same, compressed",
    open=open_npy_gz,
    matches=_is_npy_gz,
    extensions=(".gz",),
    writer=Writer(
        bits=functools.partial(_write_bits, write_npy_gz),
        counts=functools.partial(_write_counts, write_npy_gz),
        extensions=(".npy.gz",),
        keeps_sensor=True,
        keeps_label=True,
    ),
    verify=verify_cube,
)

NPZ = Format(
    "npz",
    "an archive of arrays of NumPy",
    open=open_npz,
    matches=lambda path: has_type(path, "zip"),
    extensions=(".npz",),
    has_keys=True,
    writer=Writer(counts=_write_npz_counts, extensions=(".npz",), keeps_label=True),
    verify=verify_npz,
)
