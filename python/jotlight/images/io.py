"""Pictures in and out of files."""

import json
import math
import os
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.formats.arrays import read_npy
from jotlight.formats.limits import check_claimed_size
from jotlight.formats.tiff import open_checked_tiff
from jotlight.images.color import luma
from jotlight.images.exr import check_exr, write_exr

Picture = npt.NDArray[np.floating[Any]]

DISPLAYED = (".png", ".jpg", ".jpeg")
"""The endings of pictures to look at."""

FLOATS = (".tif", ".tiff", ".exr", ".npy")
"""The endings of pictures in numbers, never clipped."""

_ORIENTATION = 0x0112
"""The tag of EXIF."""


def read_image(
    path: str | os.PathLike[str], *, white: float | None = None, gray: bool = False
) -> Picture:
    """Read a photograph as intensities.

    Parameters
    ----------
    path : path
        PNG, JPEG or whatever else Pillow reads, TIFF, or `.npy`.
    white : float, optional
        The level that becomes intensity 1. Default: the full scale of 8-bit photographs and of
        16-bit PNG, and 1 for floats. Other integers need it, since nothing tells their scale.
    gray : bool
        Turn colour into grey, the luma 0.299 R + 0.587 G + 0.114 B of ITU-R BT.601.

    Returns
    -------
    ndarray of float32 or float64, shape (H, W) or (H, W, 3)
        Intensities. Transparency is left out, the orientation noted by the camera is applied.

    Raises
    ------
    OSError, ValueError
        When the file cannot be read, or the scale is unknown.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no picture file {path}")
    if path.suffix.lower() == ".npy":
        array, scale = np.asarray(read_npy(path)), None
    elif path.suffix.lower() in (".tif", ".tiff"):
        array, scale = _read_tiff(path)
    else:
        array, scale = _read_with_pillow(path)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{path}: expected numbers, got {array.dtype}")
    if array.dtype.kind == "f":
        scale = 1.0
    if white is not None:
        if not 0 < white < math.inf:
            raise ValueError(f"white: expected a finite level above 0, got {white}")
        scale = white
    if scale is None:
        raise ValueError(
            f"{path}: the scale of its {array.dtype} values is unknown; give the level that "
            "stands for intensity 1, white= (--white), such as 1023 for a 10-bit camera"
        )
    if gray and array.ndim == 3 and array.shape[2] != 3:
        raise ValueError(f"{path}: expected red, green and blue for grey, got {array.shape}")
    if gray and array.ndim == 3:
        grey = luma(array)
        array = np.rint(grey) if array.dtype.kind in "iu" else grey
    if array.dtype != np.float64:
        array = array.astype(np.float32)
    return np.asarray(array / np.asarray(scale, array.dtype))


def _read_with_pillow(path: Path) -> tuple[npt.NDArray[Any], float | None]:
    from PIL import Image, ImageOps, UnidentifiedImageError

    try:
        with Image.open(path) as file:
            size = file.width * file.height * len(file.getbands())
            check_claimed_size("the header", size, path.stat().st_size)
            if (deep := _read_png16(path)) is not None:
                return _turned(deep, file.getexif().get(_ORIENTATION, 1)), 65535.0
            picture = ImageOps.exif_transpose(file)
            if picture.mode in ("I;16", "I;16B", "I"):
                return np.asarray(picture).astype(np.int32), 65535.0
            if picture.mode == "F":
                return np.asarray(picture), 1.0
            keeps = picture.mode in ("L", "RGB")
            grey = picture.mode in ("1", "LA", "L")
            picture = picture if keeps else picture.convert("L" if grey else "RGB")
            return np.asarray(picture), 255.0
    except UnidentifiedImageError as error:
        raise ValueError(f"{path}: expected a picture, but no known format fits") from error
    except Image.DecompressionBombError as error:
        raise ValueError(f"{path}: {error}") from error
    except Exception as error:  # anything: Pillow does not check all that it reads
        if str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: the picture is damaged or truncated ({error})") from error


def _read_png16(path: Path) -> npt.NDArray[np.uint16] | None:
    """A 16-bit PNG of which Pillow would keep 8 bits, without its transparency; else None."""
    import png

    with path.open("rb") as file:
        start = file.read(26)
    # The header comes first: bit depth and colour type stand at fixed places.
    depth, colour_type = start[24:25], start[25:26]
    if start[:4] != b"\x89PNG" or depth != b"\x10" or colour_type not in (b"\2", b"\4", b"\6"):
        return None
    try:
        width, height, rows, facts = png.Reader(bytes=path.read_bytes()).read()
        values = np.array([np.asarray(row, np.uint16) for row in rows])
    except (png.Error, zlib.error, EOFError) as error:
        raise ValueError(f"{path}: the picture is damaged or truncated ({error})") from error
    values = values.reshape(height, width, facts["planes"])
    return values[..., 0] if colour_type == b"\4" else values[..., :3]


def _turned(array: npt.NDArray[Any], orientation: int) -> npt.NDArray[Any]:
    """An image turned upright from one of the eight orientations of EXIF."""
    if orientation in (5, 6, 7, 8):
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return array


def _read_tiff(path: Path) -> tuple[npt.NDArray[Any], float | None]:
    try:
        with open_checked_tiff(path) as file:
            series = file.series[0]
            size = series.size * series.dtype.itemsize
            check_claimed_size("the header", size, path.stat().st_size)
            array = np.asarray(series.asarray())
    except Exception as error:  # anything: tifffile does not check what it reads
        raise ValueError(f"{path}: the TIFF file cannot be read ({error})") from error
    if array.ndim == 3 and array.shape[2] == 4:  # transparency
        array = array[..., :3]
    return array, 255.0 if array.dtype == np.uint8 else None


def image_writer(
    path: str | os.PathLike[str],
    *,
    depth: int = 8,
    white: float = 1.0,
    note: Mapping[str, Any] | None = None,
) -> Callable[[Path, Picture], None]:
    """Find how to write a picture to `path`, before it is made.

    Parameters
    ----------
    path : path
        Its ending chooses: `.png` and `.jpg` for display; `.tif` and `.exr` (float32) and `.npy`
        for numbers, which are written as they are and never clipped.
    depth : {8, 16}
        Bits of a PNG.
    white : float
        The intensity that becomes white in PNG and JPEG; what is brighter is white too.
    note : mapping, optional
        What JSON can hold, kept in the ImageDescription of a TIFF and the `comments` of an EXR.

    Returns
    -------
    callable
        ``write(file, picture)``, where `file` has the same ending as `path`.

    Raises
    ------
    ValueError
        For an unknown ending, or a depth that the format does not have.
    MissingExtraError
        For `.exr` without the package OpenEXR.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (*DISPLAYED, *FLOATS):
        raise ValueError(
            f"{path}: expected a name that ends in .png, .jpg, .tif, .exr or .npy, "
            f"got {suffix or 'none'}"
        )
    if suffix == ".exr":
        check_exr()
    if depth not in (8, 16) or (depth == 16 and suffix != ".png"):
        raise ValueError(
            f"depth: expected 8, or 16 for a .png, got {depth} for {suffix}; "
            ".tif, .exr and .npy hold floats"
        )

    def write(file: Path, picture: Picture) -> None:
        if suffix == ".npy":
            with file.open("wb") as handle:
                np.save(handle, picture)
        elif suffix in (".tif", ".tiff"):
            import tifffile

            photometric = "rgb" if picture.ndim == 3 else "minisblack"
            told: dict[str, Any] = {}
            if note:
                told = {"description": json.dumps(dict(note)), "metadata": None}
            tifffile.imwrite(file, picture.astype(np.float32), photometric=photometric, **told)
        elif suffix == ".exr":
            write_exr(file, picture, note)
        elif depth == 16:
            _write_png16(file, levels(picture, white, 65535).astype(np.uint16))
        else:
            from PIL import Image

            image = Image.fromarray(levels(picture, white, 255).astype(np.uint8))
            if suffix == ".png":
                image.save(file, optimize=True)
            else:
                image.save(file, quality=95)

    return write


def levels(picture: Picture, white: float, most: int) -> Picture:
    """Whole display levels from 0 to `most`, `white` and what is brighter becoming `most`."""
    return np.asarray(np.rint(np.clip(picture / np.float64(white), 0, 1) * most))


def _write_png16(file: Path, values: npt.NDArray[np.uint16]) -> None:
    # Pillow has no 16-bit colour.
    import png

    height, width = values.shape[:2]
    writer = png.Writer(width, height, greyscale=values.ndim == 2, bitdepth=16)
    with file.open("wb") as handle:
        writer.write(handle, values.reshape(height, -1))
