"""Captures written in the formats that users have: whole or not at all, part by part."""

import contextlib
import dataclasses
import gzip
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.files import atomic_folder, atomic_write
from jotlight.formats import spad512s, swissspad
from jotlight.formats.arrays import LABEL
from jotlight.formats.description import make_counts_label
from jotlight.formats.hdf5 import write_hdf5
from jotlight.formats.matlab import write_matlab
from jotlight.formats.npy import described, write_cube
from jotlight.formats.visionsim import write_visionsim
from jotlight.formats.zarr import write_zarr
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, read_in_chunks
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.sensor import Sensor

Counts = npt.NDArray[np.int32]


@dataclasses.dataclass(frozen=True)
class Writer:
    """A format that is written."""

    extensions: tuple[str, ...]
    """How a file's name ends; the first is what a message names. None: a folder."""
    bits: bool = True
    counts: bool = False
    keeps_sensor: bool = False
    """Whether it has a place for the true width, the sensor and the provenance of bits."""
    keeps_label: bool = False
    """Whether it has a place for the frames and the provenance of counts."""
    folder: bool = False
    """Whether it can be a folder."""


WRITERS = {
    "npy": Writer((".npy",), counts=True, keeps_sensor=True),
    "npy.gz": Writer((".npy.gz",), counts=True, keeps_sensor=True),
    "visionsim": Writer((), folder=True),
    "swissspad2": Writer((".bin",), folder=True),
    "swissspad2-full": Writer((".bin",), folder=True),
    "spad512s": Writer((".bin",), folder=True),
    "spad512s-sparse": Writer((".bin",), folder=True),
    "matlab": Writer((), folder=True),
    "hdf5": Writer((".h5", ".hdf5"), counts=True, keeps_sensor=True, keeps_label=True),
    "zarr": Writer((".zarr",), counts=True, keeps_sensor=True, keeps_label=True, folder=True),
    "npz": Writer((".npz",), bits=False, counts=True, keeps_label=True),
    "tiff": Writer((".tif", ".tiff"), bits=False, counts=True, keeps_label=True),
    "png": Writer((".png",), bits=False, counts=True),
}
"""The name of each format that is written."""


def choose_output_format(path: Path, name: str | None = None) -> str:
    """The format to write to a path: the one told, or what its name tells.

    Raises
    ------
    ValueError
        When the name of the file tells none, or another.
    """
    if name is not None and name not in WRITERS:
        raise ValueError(f"to: expected one of {', '.join(WRITERS)}, got {name!r}")
    ending = ".npy.gz" if path.name.lower().endswith(".npy.gz") else path.suffix.lower()
    fit = [each for each, target in WRITERS.items() if ending in target.extensions]
    fit += [each for each, target in WRITERS.items() if target.folder and ending == ""]
    if name is None and len(fit) == 1:
        return fit[0]
    if name is None:
        raise ValueError(
            f"{path}: this name tells no single format; give the one to write (--to): "
            f"{', '.join(fit or WRITERS)}"
        )
    if name not in fit:
        target = WRITERS[name]
        ways = (
            [f"a name that ends in {' or '.join(target.extensions)}"] if target.extensions else []
        )
        ways += ["a name without ending, of a new folder,"] if target.folder else []
        raise ValueError(f"{path}: expected {' or '.join(ways)} for {name}")
    return name


def write_capture(
    data: Bits | Counts,
    path: Path,
    name: str,
    progress: Callable[[float], object] = lambda share: None,
    *,
    trials: int | None = None,
    provenance: Provenance | None = None,
) -> None:
    """Write bits, or an image of counts, in the format of this name.

    Where there is a place for it, a file of counts tells out of how many `frames` they are, and
    their `provenance`.

    Raises
    ------
    OSError
        When the file cannot be written.
    ValueError
        When the format does not hold such data.
    """
    target = WRITERS[name]
    if not isinstance(data, Bits):
        if not target.counts:
            raise ValueError(
                f"{name}: holds single bits, and they cannot be had of counts; write to one of "
                f"{', '.join(each for each in WRITERS if WRITERS[each].counts)}"
            )
        if not target.keeps_label:
            _tell_turn(provenance, path, name)
        with _place(path, folder=name == "zarr") as temporary:
            _write_counts(data, temporary, name, make_counts_label(trials, provenance))
        return
    if not target.bits:
        # Counts tell their frames, and nothing else of a sensor.
        if data.sensor not in (None, Sensor(frames=len(data))):
            warn(f"{path}: counts have no place for the sensor, which is left out")
        counts = data.counts(1, progress=progress)
        write_capture(counts, path, name, trials=len(data), provenance=data.provenance)
        return
    if not target.keeps_sensor:
        if data.sensor is not None:
            warn(f"{path}: {name} has no place for the sensor, which is left out")
        _tell_turn(data.provenance, path, name)
    _write_bits(_watched(data, progress), path, name)


def _tell_turn(provenance: Provenance | None, path: Path, name: str) -> None:
    """Warn that what is written will not tell how it was turned."""
    if provenance is not None and provenance.orientation != (0, False):
        warn(
            f"{path}: {name} has no place to tell that the capture is {provenance.describe_orientation()}, so a "
            "calibration is applied to it unchecked"
        )


def _write_bits(bits: Bits, path: Path, name: str) -> None:
    match name:
        case "npy":
            write_cube(bits, path)
        case "npy.gz":
            shape = bits.packed.shape
            with described(path, shape, bits.width, bits.sensor, bits.provenance) as cube:
                _write_gzip(cube, bits.packed)
        case "hdf5":
            with atomic_write(path) as temporary:
                write_hdf5(temporary, bits)
        case "visionsim" | "matlab" | "zarr":
            write: dict[str, Callable[[Path, Bits], None]] = {
                "visionsim": write_visionsim,
                "matlab": write_matlab,
                "zarr": write_zarr,
            }
            with atomic_folder(path) as folder:
                write[name](folder, bits)
        case _:
            _write_raw(bits, path, name)


def _write_raw(bits: Bits, path: Path, name: str) -> None:
    """Write frames without a header: one file, or a folder of files of the camera's size."""
    trailer = b""
    if name.startswith("swissspad2"):
        at_once, encode = swissspad.raw_bytes(bits, name)
        file_name = "{0}/{1}/filename{2}.bin"
    else:
        at_once, encode = spad512s.raw_bytes(bits, sparse=name == "spad512s-sparse")
        file_name = "RAW{2:05d}.bin"
        trailer = b"" if name == "spad512s-sparse" else spad512s.TRAILER
    if path.suffix:
        with atomic_write(path) as temporary:
            _write_frames(temporary, bits.packed, encode, trailer)
        return
    with atomic_folder(path) as folder:
        for number, start in enumerate(range(0, len(bits), at_once)):
            file = folder / file_name.format(number // 2048, number // 64, number)
            file.parent.mkdir(parents=True, exist_ok=True)
            _write_frames(file, bits.packed[start : start + at_once], encode, trailer)


def _write_frames(
    path: Path,
    frames: npt.NDArray[np.uint8] | Frames,
    encode: Callable[[npt.NDArray[np.uint8]], npt.NDArray[np.uint8]],
    trailer: bytes,
) -> None:
    with path.open("wb") as file:
        for _, part in read_in_chunks(frames, 1 << 20):
            file.write(encode(part).tobytes())
        file.write(trailer)


def _write_counts(counts: Counts, path: Path, name: str, told: str | None) -> None:
    most = int(counts.max())
    small = counts.astype(np.uint8 if most < 1 << 8 else np.uint16 if most < 1 << 16 else np.uint32)
    match name:
        case "npy":
            with path.open("wb") as file:
                np.save(file, counts)
        case "npy.gz":
            _write_gzip(path, counts)
        case "npz":
            with path.open("wb") as file:
                np.savez_compressed(file, counts=counts)
            if told is not None:
                with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
                    # With a time of its own the same data would become other bytes.
                    archive.writestr(zipfile.ZipInfo(LABEL), told)
        case "hdf5":
            write_hdf5(path, counts, told)
        case "zarr":
            write_zarr(path, counts, told)
        case "tiff":
            import tifffile

            if counts.ndim == 3 and counts.shape[2] not in (3, 4):
                raise ValueError(f"tiff: expected 1 or 3 channels, got {counts.shape[2]}")
            photometric = "minisblack" if counts.ndim == 2 else "rgb"
            tifffile.imwrite(path, small, photometric=photometric, metadata=None, description=told)
        case _:
            from PIL import Image

            if counts.ndim != 2 or most >= 1 << 16:
                raise ValueError(
                    f"png: expected counts (H, W) below 65536, got {counts.shape} up to {most}; "
                    "tiff holds more"
                )
            Image.fromarray(small).save(path, "PNG")


def _write_gzip(path: Path, array: npt.NDArray[np.generic] | Frames) -> None:
    header = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
    # The name and the time would make the same data into other bytes.
    with path.open("wb") as raw, gzip.GzipFile("", "wb", 6, raw, mtime=0) as file:
        np.lib.format.write_array_header_1_0(file, header)
        for _, part in read_in_chunks(array, 1 << 20):
            file.write(np.ascontiguousarray(part).tobytes())


@contextlib.contextmanager
def _place(path: Path, *, folder: bool) -> Iterator[Path]:
    with atomic_folder(path) if folder else atomic_write(path) as temporary:
        yield temporary


def _watched(bits: Bits, progress: Callable[[float], object]) -> Bits:
    """The same bits, telling how far they have been read."""

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        part = bits.packed[start:stop, ...]
        progress(stop / len(bits))
        return np.asarray(part)

    return Bits(Frames(bits.packed.shape, read), bits.width, bits.sensor, bits.provenance)
