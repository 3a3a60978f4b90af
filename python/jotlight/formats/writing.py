"""Writing of captures in any format, part by part, and completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Counts
from jotlight.checks import refuse_masked, to_array
from jotlight.disk_space import check_disk_space
from jotlight.errors import warn
from jotlight.files import refuse_folder
from jotlight.formats.frames.labels import make_counts_label
from jotlight.formats.registry import WRITERS
from jotlight.layout import MAX_CHANNELS
from jotlight.parameter_names import check_choice
from jotlight.paths import as_path
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames, read_frames
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor


def choose_output_format(path: Path, name: str | None = None) -> str:
    """Return the format to write to a path: `name`, or the one that the extension implies.

    Raises
    ------
    OSError
        When the path is a folder, and no format is requested.
    ValueError
        When `name` is unknown, the extension implies no single format, or the two disagree.

    Examples
    --------
    >>> choose_output_format(Path("a.npy.gz")), choose_output_format(Path("a.bin"), "swissspad2")
    ('npy.gz', 'swissspad2')
    """
    if name is not None:
        check_choice("format= (--to)", name, WRITERS)
    extension = ".npy.gz" if path.name.lower().endswith(".npy.gz") else path.suffix.lower()
    candidates = [
        each
        for each, writer in WRITERS.items()
        if extension in writer.extensions or (writer.folder and extension == "")
    ]
    if len(candidates) != 1 and name is None:
        refuse_folder(path, "capture.npy", may_be_new=True)
    if not candidates:
        known = dict.fromkeys(each for writer in WRITERS.values() for each in writer.extensions)
        raise ValueError(
            f"{path}: captures are not written with the ending {extension}; choose one of "
            f"{', '.join(known)}, or none for a new folder"
        )
    if name is None and len(candidates) == 1:
        return candidates[0]
    if name is None:
        ending = "" if extension else "add an ending, such as .npy, or "
        raise ValueError(
            f"{path}: this name implies no single format; {ending}pass format= (--to): "
            f"{', '.join(candidates)}"
        )
    if name not in candidates:
        writer = WRITERS[name]
        allowed = []
        if writer.extensions:
            allowed.append(f"a name that ends in {' or '.join(writer.extensions)}")
        if writer.folder:
            allowed.append("a name without extension, of a new folder,")
        raise ValueError(f"{path}: expected {' or '.join(allowed)} for {name}")
    return name


def _advice(data: object) -> str:
    """Return what writes data that are neither bits nor counts."""
    if isinstance(data, np.ndarray) and data.dtype == np.bool_:
        return "; jotlight.Bits.from_array(frames, sensor) packs frames of bits"
    if isinstance(data, np.ndarray) and data.dtype.kind == "f":
        is_whole = bool((data == np.rint(data)).all())
        cast = "; write counts.astype(int) for counts" if is_whole else ""
        return f'{cast}; jotlight.save_image("image.tif", image) writes an image'
    if isinstance(data, Merged):
        return '; numpy.savez("merged.npz", ones=merged.ones, trials=merged.trials) writes them'
    if _are_bits(data):
        return "; write each of them to a file of its own"
    return "; their own method save writes them" if hasattr(data, "save") else ""


def _are_bits(data: object) -> bool:
    """Return whether data are a list of bits, which is not empty."""
    return (
        isinstance(data, list | tuple)
        and len(data) > 0
        and all(isinstance(each, Bits) for each in data)
    )


def _checked_counts(data: object) -> Counts:
    """Return an image of counts after a check."""
    # Lists of bits, and other objects, would become arrays that are no counts.
    looks_like_one = isinstance(data, list | tuple) or hasattr(data, "__array__")
    is_array = looks_like_one and not (isinstance(data, Merged) or _are_bits(data))
    counts = to_array("data", data) if is_array else np.array(None)
    if counts.dtype.kind not in "iu":
        kind = getattr(data, "dtype", type(data).__name__)
        raise TypeError(
            f"data: expected jotlight.Bits or an array of counts, got {kind}{_advice(data)}"
        )
    if counts.ndim not in (2, 3) or counts.size == 0:
        raise ValueError(f"data: expected counts (H, W) or (H, W, C), got shape {counts.shape}")
    if counts.ndim == 3 and counts.shape[2] > MAX_CHANNELS:
        raise ValueError(
            f"data: expected counts (H, W) or (H, W, C) with at most {MAX_CHANNELS} channels, got "
            f"shape {counts.shape}; jotlight.Bits.from_array(frames, sensor) packs frames of bits, "
            "and frames.sum(0) is one image of all"
        )
    if counts.min() < 0 or counts.max() >= 2**31:
        raise ValueError(
            f"data: expected counts from 0 to 2**31 - 1, got {counts.min()} to {counts.max()}"
        )
    return counts.astype(np.int32)


def save(
    data: Bits | Readings | npt.ArrayLike,
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
) -> None:
    """Write bits, or an image of counts, to a file or folder that :func:`jotlight.open` reads.

    Either all files appear, or none. A `.npy` of bits is a photon cube: every program that reads
    photon cubes opens it, and ``numpy.unpackbits`` unpacks it. A `.json` next to it stores the true
    width, the provenance, and the sensor. Each map of the sensor is a separate `.npy` file.

    Parameters
    ----------
    data : Bits, Readings, or array_like of int, shape (H, W) or (H, W, C)
        Bits or readings of several bits, which are written part by part, or counts. Bits are summed
        to counts if the format has only counts. `.npy` and `.tif` hold readings and their sensor.
    path : path
        A file, or for a format of many files a new folder.
    format : str, optional
        Name of the format. Default: the one that the extension implies.

    Raises
    ------
    TypeError
        When `data` is neither :class:`jotlight.Bits` nor an array of integers.
    ValueError
        When the extension implies no single format, the format cannot hold the data, or the bits
        come from a file that differs from its checksums.
    OSError
        When a file cannot be written, or would replace one that jotlight did not write.

    Warns
    -----
    JotlightWarning
        When the format has only counts, so that the bits of several frames are summed.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "capture.npy"
    >>> jl.save(jl.Bits.from_array(np.eye(10, dtype=bool)), path)
    >>> jl.open(path)
    <Bits: 1 frame of 10 x 10 jots>
    """
    path = as_path(path, 'jotlight.save(bits, "capture.npy")')
    refuse_masked("data", data)
    if not isinstance(data, Bits | Readings):
        data = _checked_counts(data)
    name = choose_output_format(path, format)
    if isinstance(data, Bits) and len(data) > 1 and WRITERS[name].bits is None:
        warn(
            f"{path}: {name} stores counts, so only the sum of the {len(data)} frames is saved; "
            "save to a name that ends in .npy to keep the bits"
        )
    write_capture(data, path, name)


def write_capture(
    data: Bits | Readings | Counts,
    path: Path,
    name: str,
    progress: Callable[[float], object] = lambda fraction: None,
    *,
    trials: int | None = None,
    provenance: Provenance | None = None,
) -> None:
    """Write bits, or an image of counts, in the format of this name.

    Bits in a format that only has counts are summed. Bits from a file are written only if the file
    matches its checksums.

    Parameters
    ----------
    data : Bits or ndarray of int32, shape (H, W) or (H, W, C)
    path : path
        A file, or for a format of many files a new folder.
    name : str
        One of ``jotlight.formats.registry.WRITERS``.
    progress : callable, optional
        A function that is called repeatedly with the completed fraction, from 0 to 1.
    trials : int, optional
        For counts: number of binary readings behind each count.
    provenance : Provenance, optional
        For counts: their provenance. Bits have their own.

    Raises
    ------
    OSError
        When the file cannot be written.
    ValueError
        When the format cannot hold such data, or the bits come from a damaged file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "counts.tif"
    >>> write_capture(np.ones((4, 5), np.int32), path, "tiff", trials=100)
    >>> path.is_file()
    True
    """
    if isinstance(data, Readings):
        _write_readings(data, path, name)
    elif isinstance(data, Bits):
        if isinstance(data.packed, Frames):
            data.packed.verify()
        _write_bits(data, path, name, progress)
    else:
        _write_counts(data, path, name, trials, provenance)


def _write_bits(bits: Bits, path: Path, name: str, progress: Callable[[float], object]) -> None:
    writer = WRITERS[name]
    if writer.bits is None:
        # The label of counts holds the number of frames, but nothing else of a sensor.
        if bits.sensor not in (None, Sensor(frames=len(bits))):
            warn(f"{path}: a file of counts has no place for the sensor, which is left out")
        counts = bits.counts(1, progress=progress)
        _write_counts(counts, path, name, len(bits), bits.provenance)
        return
    if not writer.keeps_sensor:
        if bits.sensor is not None:
            warn(f"{path}: {name} has no place for the sensor, which is left out")
        _warn_about_orientation(bits.provenance, path, name)
    if writer.plain:
        check_disk_space([(path, bits.packed.nbytes)])
    writer.bits(_report_reading(bits, progress), path)


def _write_readings(readings: Readings, path: Path, name: str) -> None:
    writer = WRITERS[name]
    if writer.readings is None:
        names = ", ".join(each for each in WRITERS if WRITERS[each].readings)
        raise ValueError(
            f"{name}: has no place for readings of several bits; write to one of {names}"
        )
    if isinstance(readings.frames, Frames):
        readings.frames.verify()
    writer.readings(readings, path)


def _write_counts(
    counts: Counts, path: Path, name: str, trials: int | None, provenance: Provenance | None
) -> None:
    writer = WRITERS[name]
    if writer.counts is None:
        names = ", ".join(each for each in WRITERS if WRITERS[each].counts)
        raise ValueError(
            f"{name}: stores single bits, which counts cannot become; write to one of {names}"
        )
    if not writer.keeps_label:
        _warn_about_orientation(provenance, path, name)
    writer.counts(counts, path, make_counts_label(trials, provenance))


def _warn_about_orientation(provenance: Provenance | None, path: Path, name: str) -> None:
    """Warn that the file will not record how the capture was rotated and mirrored."""
    if provenance is not None and provenance.orientation != (0, False):
        warn(
            f"{path}: {name} has no place to record that the capture is "
            f"{provenance.describe_orientation()}, so no check of a calibration's orientation is "
            "possible later"
        )


def _report_reading(bits: Bits, progress: Callable[[float], object]) -> Bits:
    """Return the same bits, whose frames report their fraction to `progress` when they are read."""

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        part = read_frames(bits.packed, start, stop)
        progress(stop / len(bits))
        return part

    return bits.replace(packed=Frames(bits.packed.shape, read))
