"""Selection of one of the named arrays of an HDF5 file or zarr folder, as bits or counts."""

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import numpy as np

from jotlight.errors import SeveralArraysError
from jotlight.formats.capture import Capture
from jotlight.formats.files.limits import check_frame_size
from jotlight.formats.frames.count_stacks import as_count_stack
from jotlight.formats.frames.labels import AS_STATED, BITS, make_bits_label, parse_label
from jotlight.formats.frames.packing import check_packed, pack_lazily
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.layout import is_single_image
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import refuse_many_channels, warn_about_axes
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.maps import MAPS
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor

ATTRIBUTE = "jotlight"
"""Name of the attribute that holds the label of an array."""


@dataclasses.dataclass(frozen=True)
class StoredArray:
    """An open array in a file. Its frames are read when needed."""

    frames: Frames
    file_bytes: int
    """Number of bytes of the files that hold it."""


@dataclasses.dataclass(frozen=True)
class ListedArray:
    """An array that a file lists, and its label if jotlight wrote one."""

    label: str | None
    open: Callable[[], StoredArray]
    """Function that checks and opens the array. It raises ValueError if the array cannot be read.
    The other arrays of the file can then still be read."""
    unreadable: str | None = None
    """A word that says why the array cannot be opened, if the file states this, or None."""


def bits_label(bits: Bits) -> str:
    """Return the label of packed bits as JSON. Each map is an array with the name of the map."""
    label = make_bits_label(bits.width, bits.sensor, bits.provenance)
    if bits.sensor is not None:
        label["maps"] = {name: name for name in bits.sensor.maps()}
    return json.dumps(label)


def open_stored_array(
    arrays: dict[str, ListedArray], provenance: Provenance, options: ReadingOptions
) -> Capture:
    """Return the capture in one of several arrays.

    Parameters
    ----------
    arrays : dict
        All arrays of the file by name.
    provenance : Provenance
        Provenance of the file.
    options : ReadingOptions
        If `key` is None, the array is the only one, or else the only one with a label.

    Raises
    ------
    ValueError
        When the array cannot be chosen, or its shape, type or label is invalid.
    """
    key, name = _select_key(arrays, provenance.name, options.path_key), provenance.name
    array, text, counts = arrays[key].open(), arrays[key].label, options.takes_counts
    frames = array.frames
    try:
        label = None if text is None else parse_label(text, BITS)
        if label is not None and counts:
            raise ValueError(f"its label states packed bits, not counts; {AS_STATED}")
        if label is not None:
            return _open_labeled_bits(arrays, frames, label, provenance, options.packed_width)
        if counts is None and frames.dtype.kind == "b":
            counts = len(frames.shape) == 2
        if counts or (counts is None and frames.dtype.kind != "b"):
            if is_single_image(frames.shape):  # which is in memory as a whole
                check_frame_size(name, frames.nbytes, array.file_bytes)
            return as_count_stack(frames, provenance, text, floats=options.takes_floats)
        if len(frames.shape) not in (3, 4) or 0 in frames.shape:
            raise ValueError(f"expected frames (T, H, W) or (T, H, W, C), got {frames.shape}")
        refuse_many_channels(name, frames.shape)
        if frames.dtype.kind == "b":
            warn_about_axes(name, frames.shape)
            return Bits(pack_lazily(frames, name), frames.shape[2], provenance=provenance)
        if not options.is_packed:
            check_packed(frames, name)
        provenance = provenance.with_notes(
            "packed bits, the most significant first, along the width"
        )
        return Bits(frames, options.packed_width, provenance=provenance)
    except (TypeError, ValueError) as error:
        if name in str(error):
            raise
        raise ValueError(f"{name}: {key}: {error}") from error


def _select_key(arrays: dict[str, ListedArray], name: str, key: str | None) -> str:
    """Return the key of the chosen array of the file `name`, or of the only one that it can be."""
    labeled = [each for each, array in arrays.items() if array.label is not None]
    if key is None and (len(arrays) == 1 or len(labeled) == 1):
        return next(iter(labeled or arrays))
    if key is None or key not in arrays:
        raise several_arrays_error(name, arrays, key, "array")
    return key


def several_arrays_error(
    path: object, arrays: dict[str, ListedArray], key: str | None, kind: str
) -> SeveralArraysError:
    """Return the error for a file of these arrays, and a key that is none of their names."""
    unreadable = {name: each.unreadable for name, each in arrays.items() if each.unreadable}
    return SeveralArraysError.of_file(path, list(arrays), key, kind, unreadable)


def _open_labeled_bits(
    arrays: dict[str, ListedArray],
    frames: Frames,
    label: dict[str, Any],
    provenance: Provenance,
    width: int | None,
) -> Bits:
    """Return packed bits with the sensor and the provenance that their label states."""
    if type(label.get("width")) is not int:
        raise ValueError("expected the label of packed bits to state their width")
    if width not in (None, label["width"]):
        raise ValueError(f"its label states a width of {label['width']}, not {width}")
    bits = Bits(frames, label["width"])
    if label.get("provenance") is not None:
        provenance = provenance.converted_from(Provenance.from_json(label["provenance"]))
    if label.get("sensor") is None:
        return Bits(frames, bits.width, provenance=provenance)
    keys = label.get("maps") or {}
    if not isinstance(keys, dict) or not keys.keys() <= set(MAPS):
        raise ValueError(f"maps: expected arrays for {' and '.join(MAPS)}, got {keys!r}")
    maps = {}
    for name, key in keys.items():
        map_ = arrays[key].open().frames if key in arrays else None
        if map_ is None or map_.shape != bits.shape[1:3]:
            raise ValueError(f"{name}: expected an array {key!r} of {bits.shape[1:3]} jots")
        maps[name] = np.asarray(map_)
    return Bits(frames, bits.width, Sensor.from_parts(label["sensor"], maps), provenance)
