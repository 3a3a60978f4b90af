"""Camera data, one file per family."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.formats.arrays import read_npy, read_npz_label
from jotlight.formats.capture import (
    Capture,
    CountStack,
    as_count_stack,
    pack_lazily,
    pack_stack,
    select,
)
from jotlight.formats.compressed import open_npy_gz, open_npz
from jotlight.formats.detect import FORMATS, RAW, detect_format
from jotlight.formats.hdf5 import open_hdf5
from jotlight.formats.image_files import open_png, open_tiff
from jotlight.formats.matlab import open_matlab
from jotlight.formats.npy import load_bits, open_described_cube, write_cube
from jotlight.formats.spad512s import open_spad512s
from jotlight.formats.swissspad import open_swissspad
from jotlight.formats.visionsim import open_visionsim
from jotlight.formats.zarr import open_zarr
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames
from jotlight.sensing.provenance import Provenance

_KEYED = ("npz", "matlab", "hdf5", "zarr")


def open(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    width: int | None = None,
    frames: slice | None = None,
    rotate: int = 0,
    flip: str | None = None,
    key: str | None = None,
    counts: bool | None = None,
    unpacked: bool | None = None,
) -> Bits | npt.NDArray[np.int32]:
    """Open a capture, of any size: bits are read from their files as they are needed.

    Parameters
    ----------
    path : path
        A file, or a folder of files.
    format : str, optional
        One of ``jotlight.formats.FORMATS``. Default: what the content tells; raw frames (`.bin`)
        tell nothing, so that it has to be given.
    width : int, optional
        The true width in jots, where the file does not tell.
    frames : slice, optional
        Some of the frames, such as ``slice(100, 200)``.
    rotate : int
        Degrees to rotate by, anticlockwise, a multiple of 90, on top of what the format has.
    flip : {"horizontal", "vertical"}, optional
        Exchange left and right, or top and bottom, after that.
    key : str, optional
        The name of the array where a file has several.
    counts : bool, optional
        Whether the numbers are counts, or bits. Default: uint8 (T, H, W / 8) in a `.npy` is packed
        bits, and so is what jotlight wrote as such; bool with a time is bits; all else is counts.
    unpacked : bool, optional
        Whether each number is one bit, 0 and 1 or 0 and 255, or a byte has eight. Default: eight,
        and a file is refused whose frames do not look so.

    Returns
    -------
    Bits
        With ``provenance``, which tells what was assumed.
    ndarray of int32, shape (H, W) or (H, W, C)
        For counts; a stack of images is summed, with a warning unless `frames` were chosen.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When it is not of a known format, truncated, or holds Python objects, which are never read.
    MissingExtraError
        When a package is needed that is not installed.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "cube.npy"
    >>> np.save(path, np.packbits(np.ones((4, 6, 16), bool), axis=2))
    >>> bits = open(path)
    >>> bits
    <Bits: 4 frames of 6 x 16 jots>
    >>> bits.provenance.notes[0]
    'taken for bits, the most significant first, along the width'
    """
    capture = open_capture(
        path,
        format=format,
        width=width,
        frames=frames,
        rotate=rotate,
        flip=flip,
        key=key,
        counts=counts,
        unpacked=unpacked,
    )
    if isinstance(capture, Bits):
        return capture
    if len(capture.images) > 1 and frames is None:
        warn(f"{path}: gives the sum of its {len(capture.images)} images of counts")
    return capture.sum()


def open_capture(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    width: int | None = None,
    frames: slice | None = None,
    rotate: int = 0,
    flip: str | None = None,
    key: str | None = None,
    counts: bool | None = None,
    unpacked: bool | None = None,
) -> Capture:
    """Open a capture as :func:`open` does, with images of counts not yet summed."""
    path = Path(path)
    if format is not None and format not in FORMATS:
        raise ValueError(f"format: expected one of {', '.join(FORMATS)}, got {format!r}")
    name = format or detect_format(path)
    if key is not None and name not in _KEYED:
        raise ValueError(f"key: names an array in a file of several, and {path} ({name}) has one")
    if unpacked and counts:
        raise ValueError(
            "counts: with unpacked each number is one bit; give only one (--counts, --unpacked)"
        )
    if unpacked and name in (*RAW, "visionsim"):
        raise ValueError(f"unpacked: is for bits in arrays and pictures, not for {path} ({name})")
    try:
        if unpacked:
            capture = _opened(path, name, key, True, None)
            capture = pack_stack(capture) if isinstance(capture, CountStack) else capture
        else:
            capture = _opened(path, name, key, counts, width, sure=unpacked is False)
    except ValueError as error:
        if str(path) in str(error):
            raise
        raise ValueError(f"{path}: {error}") from error
    if not unpacked and counts is not None and counts == isinstance(capture, Bits):
        words = "bits" if counts else "counts; --unpacked takes each number for a bit"
        raise ValueError(f"counts: {path} ({name}) holds {words}")
    if width is not None:
        have = capture.images.shape[2] if isinstance(capture, CountStack) else capture.width
        if width != have:
            raise ValueError(f"width: expected {have}, which {path} tells, got {width}")
    return select(capture, frames, rotate, flip, key)


def _opened(
    path: Path,
    name: str,
    key: str | None,
    counts: bool | None,
    width: int | None,
    *,
    sure: bool = False,
) -> Capture:
    match name:
        case "npy":
            return _of_array(read_npy(path), path, name, counts, width, sure=sure)
        case "npy.gz":
            return _of_array(open_npy_gz(path), path, name, counts, width, sure=sure)
        case "npz":
            array, label = open_npz(path, key), read_npz_label(path)
            # What is in archives has been counts so far, unless it is bool.
            if counts is None and array.dtype != np.bool_:
                counts = True
            return _of_array(array, path, name, counts, width, label, sure=sure)
        case "matlab":
            return open_matlab(path, key=key, counts=counts)
        case "hdf5":
            return open_hdf5(path, key=key, counts=counts, width=width, sure=sure)
        case "zarr":
            return open_zarr(path, key=key, counts=counts, width=width, sure=sure)
        case "tiff" | "png":
            return open_tiff(path) if name == "tiff" else open_png(path)
    match name:
        case "visionsim":
            return open_visionsim(path)
        case "swissspad2" | "swissspad2-full":
            return open_swissspad(path, full=name == "swissspad2-full")
        case _:
            return open_spad512s(path, sparse=name == "spad512s-sparse")


def _of_array(
    array: npt.NDArray[Any] | Frames,
    path: Path,
    name: str,
    counts: bool | None,
    width: int | None,
    label: str | None = None,
    *,
    sure: bool = False,
) -> Capture:
    """Bits or counts in an array: told by its type and shape unless `counts` says."""
    dimensions = len(array.shape)
    if array.dtype == np.bool_ and dimensions in (3, 4) and not counts and 0 not in array.shape:
        provenance = Provenance(name, path.name, ("frames of bool, one bit each",))
        return Bits(pack_lazily(array, path.name), array.shape[2], provenance=provenance)
    if counts is False or (counts is None and array.dtype == np.uint8 and dimensions in (3, 4)):
        if array.dtype != np.uint8 or dimensions not in (3, 4):
            raise ValueError(
                f"{path}: expected packed bits, uint8 of shape (T, H, W/8) or (T, H, W/8, C), "
                f"got {array.dtype} of shape {array.shape}"
            )
        return open_described_cube(array, path, width, name, sure=sure)
    return as_count_stack(array, Provenance(name, path.name), label)


def save(bits: Bits, path: str | os.PathLike[str]) -> None:
    """Write bits to `path` (`.npy`, a photon cube) and their description to a `.json` beside it.

    Every program that reads photon cubes opens the `.npy`, and `numpy.unpackbits` unpacks it. The
    `.json` keeps the true width, the provenance and the sensor. The sensor's maps are `.npy` files
    of their own. Either all files appear, or none. :func:`open` reads them back.

    Parameters
    ----------
    bits : Bits
        Bits of any size; they are written part by part.
    path : path
        A name that ends in `.npy`.

    Raises
    ------
    TypeError
        For anything that is not :class:`jotlight.Bits`.
    ValueError
        When the name does not end in `.npy`.
    OSError
        When a file cannot be written, or would replace one that jotlight did not write.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "capture.npy"
    >>> save(Bits.from_array(np.eye(10, dtype=bool)), path)
    >>> open(path)
    <Bits: 1 frame of 10 x 10 jots>
    """
    if not isinstance(bits, Bits):
        raise TypeError(f"bits: expected jotlight.Bits, got {type(bits).__name__}")
    write_cube(bits, path)


__all__ = ["FORMATS", "load_bits", "open", "open_capture", "save"]
