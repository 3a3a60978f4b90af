"""Read photographs as intensities, and write images."""

from __future__ import annotations

import contextlib
import json
import os
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import FloatImage
from jotlight.checks import positive_number
from jotlight.files import refuse_folder
from jotlight.formats.files.limits import check_claimed_size
from jotlight.formats.images.png_chunks import GRAYSCALE
from jotlight.formats.images.png_notes import KEYWORD, read_png_note
from jotlight.formats.images.tiff_directories import open_checked_tiff
from jotlight.formats.npy.arrays import read_npy
from jotlight.images.color import fit_channels, luma, warn_about_transparent_pixels
from jotlight.images.exr import check_exr, read_exr, read_exr_comments, write_exr
from jotlight.images.png import checked_png, read_png16, write_png16
from jotlight.images.tiff import read_tiff, write_tiff
from jotlight.output_files import OutputFile, open_output
from jotlight.paths import as_path, pattern_advice

DISPLAYED = (".png", ".jpg", ".jpeg")
"""Endings of images for display."""

FLOATS = (".tif", ".tiff", ".exr", ".npy")
"""Endings of images that keep floats. They are never clipped."""

_READ = ("PNG", "JPEG", "BMP", "WEBP", "PPM", "GIF")
"""Formats that Pillow may open. It would pass PostScript to another program, and some of its other
formats allocate memory before their sizes are checked. PPM includes PGM."""

_PNG = {"compress_type": zlib.Z_RLE}
"""Options of a PNG of 8 bits.

The rows of a PNG are differences of neighbors. Searching them for long matches, as by default,
takes longer, and makes the files of photographs no smaller.
"""

_ORIENTATION = 0x0112
"""EXIF tag of the orientation."""


def read_image(
    path: str | os.PathLike[str], *, white: float | None = None, gray: bool = False
) -> FloatImage:
    """Return the intensities of a photograph in a file.

    Parameters
    ----------
    path : path
        PNG, JPEG, BMP, WebP, PGM, PPM, the first image of a GIF, TIFF, OpenEXR, or `.npy`.
    white : float, optional
        The level that becomes intensity 1. Default: the full scale of 8-bit photographs and of
        16-bit PNG, and 1 for floats and bool. Other integers require `white`.
    gray : bool
        Whether to convert color to gray (:func:`jotlight.images.color.luma`).

    Returns
    -------
    ndarray of float32 or float64, shape (H, W) or (H, W, 3)
        Intensities. Transparency is dropped, and the EXIF orientation is applied. The channels of a
        `.npy` have no meaning, so all of them are returned, (H, W, C). So are other channels of a
        TIFF, stacks of images in both, and floats that are not finite.

    Raises
    ------
    OSError, ValueError
        If the file cannot be read, holds no image, or its scale is unknown.
    MissingExtraError
        If `.exr` needs the package OpenEXR.

    Warns
    -----
    JotlightWarning
        When pixels are transparent.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "photo.png"
    >>> image_writer(path)(path, np.array([[0.0, 1.0]]))
    >>> jl.read_image(path)
    array([[0., 1.]], dtype=float32)
    """
    path = as_path(path, 'jotlight.read_image("photo.png")')
    if path.is_dir():
        raise IsADirectoryError(f"{path}: expected an image file, got a folder")
    if not path.is_file():
        advice = pattern_advice(path, "name one image")
        raise FileNotFoundError(f"there is no image file {path}{advice}")
    if path.suffix.lower() == ".npy":
        array, scale = _as_photograph(path, read_npy(path)), None
    elif path.suffix.lower() in (".tif", ".tiff"):
        array, scale = read_tiff(path)
    elif path.suffix.lower() == ".exr":
        array, scale = read_exr(path), None
    else:
        array, scale = _read_with_pillow(path)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{path}: expected numbers, got {array.dtype}")
    if array.dtype.kind in "bf":
        scale = 1.0
    if white is not None:
        scale = positive_number("white", white)
    if scale is None:
        raise ValueError(
            f"{path}: the scale of its {array.dtype} values is unknown; state the level of "
            "intensity 1 with white= (--white), such as 1023 for a 10-bit camera; if it is a "
            "capture, jotlight.open reads it in Python, and `jotlight reconstruct` estimates its "
            "image"
        )
    if gray and array.ndim == 3 and array.shape[2] != 3:
        raise ValueError(
            f"{path}: expected red, green, and blue to convert to gray, got {array.shape}"
        )
    if gray and array.ndim == 3:
        gray_levels = luma(array)
        array = np.rint(gray_levels) if array.dtype.kind in "iu" else gray_levels
    if array.dtype != np.float64:
        array = array.astype(np.float32)
    return np.asarray(array / np.asarray(scale, array.dtype))


def _as_photograph(path: Path, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an array of a `.npy` whose single channel, if it has one, is no axis.

    Raises
    ------
    ValueError
        When the array is no image.
    """
    if array.ndim < 2 or array.size == 0:
        raise ValueError(
            f"{path}: expected an image of shape (H, W) or (H, W, 3) with at least one pixel, got "
            f"{array.shape}; numpy.load reads other arrays"
        )
    return array[..., 0] if array.shape[2:] == (1,) else array


def _read_with_pillow(path: Path) -> tuple[npt.NDArray[Any], float | None]:
    """Return the values of an image, and the level of intensity 1."""
    from PIL import Image, ImageOps, UnidentifiedImageError
    from PIL.PngImagePlugin import PngImageFile

    try:
        with contextlib.ExitStack() as stack:
            # Pillow would map some files into memory if it opened them itself.
            stream = stack.enter_context(path.open("rb"))
            png = checked_png(stream)
            # Pillow limits the number of pixels; the size of a PNG has been checked.
            opened = PngImageFile(stream) if png else Image.open(stream, formats=_READ)
            file = stack.enter_context(opened)
            size = file.width * file.height * len(file.getbands())
            check_claimed_size("the header", size, path.stat().st_size, frame_bytes=size)
            if png is not None and png.depth == 16 and png.color_type != GRAYSCALE:
                orientation = file.getexif().get(_ORIENTATION, 1)
                return _upright(read_png16(path, stream), orientation), 65535.0
            image = ImageOps.exif_transpose(file)
            if image.has_transparency_data:
                warn_about_transparent_pixels(path, np.asarray(image.convert("RGBA"))[..., 3])
            if image.mode in ("I;16", "I;16B", "I"):
                return np.asarray(image).astype(np.int32), 65535.0
            if image.mode == "F":
                return np.asarray(image), 1.0
            if image.mode not in ("L", "RGB"):
                image = image.convert("L" if image.mode in ("1", "LA") else "RGB")
            return np.asarray(image), 255.0
    except UnidentifiedImageError as error:
        raise ValueError(
            f"{path}: expected an image, but no known format fits (PNG, JPEG, BMP, WebP, PGM, PPM, "
            "GIF; the endings of TIFF, OpenEXR, and .npy tell their formats)"
        ) from error
    except Image.DecompressionBombError as error:
        limit = 2 * (Image.MAX_IMAGE_PIXELS or 0)
        raise ValueError(
            f"{path}: expected an image of at most {limit} pixels, which is the limit of Pillow, "
            "got more; if it is no hostile file, save it as PNG or TIFF"
        ) from error
    except Exception as error:  # any type: Pillow does not check everything it reads
        if str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: the image cannot be read ({error})") from error


def _upright(array: npt.NDArray[Any], orientation: int) -> npt.NDArray[Any]:
    """Return an image with one of the eight EXIF orientations upright."""
    if orientation in (5, 6, 7, 8):
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return array


def image_writer(
    path: str | os.PathLike[str],
    *,
    depth: int = 8,
    white: float = 1.0,
    note: Mapping[str, Any] | None = None,
) -> Callable[[Path, FloatImage], None]:
    """Return a function ``write(file, image)`` for the format of `path`.

    This function checks everything about the format, before any image is computed.

    Parameters
    ----------
    path : path
        The ending chooses the format: `.png` and `.jpg` for display; `.tif` and `.exr` (float32)
        and `.npy` for floats, which are never clipped.
    depth : {8, 16}
        Bits per value of a PNG.
    white : float
        The intensity that becomes white in PNG and JPEG. Brighter pixels are white, too.
    note : mapping, optional
        Values that JSON can hold, for the ImageDescription of a TIFF, the `comments` of an EXR, the
        text `Description` of a PNG, and the comment of a JPEG. A `.npy` has no place for it.

    Returns
    -------
    callable
        ``write(file, image)`` with an image (H, W), (H, W, 1), or (H, W, 3), and for `.tif` and
        `.npy` also with two or four channels. `file` has the ending of `path`.

    Raises
    ------
    OSError
        If the path is a folder.
    ValueError
        If the ending is unknown, or the format does not have the depth.
    MissingExtraError
        If `.exr` needs the package OpenEXR.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (*DISPLAYED, *FLOATS):
        refuse_folder(path, "image.png")
        raise ValueError(
            f"{path}: expected a name that ends in .png, .jpg, .tif, .exr, or .npy, "
            f"got {suffix or 'none'}"
        )
    if suffix == ".exr":
        check_exr()
    check_depth(suffix, depth)

    def write(file: Path, image: FloatImage) -> None:
        image = fit_channels(path, image)
        if suffix == ".exr":
            write_exr(file, image, note)
            return
        with open_output(file) as handle:
            encode(handle, image)

    def encode(handle: OutputFile, image: FloatImage) -> None:
        if suffix == ".npy":
            np.save(handle, image)
        elif suffix in (".tif", ".tiff"):
            write_tiff(handle, image, note)
        elif depth == 16:
            write_png16(handle, display_levels(image, white, 65535).astype(np.uint16), note)
        else:
            from PIL import Image as PillowImage

            levels = display_levels(image, white, 255).astype(np.uint8)
            kind, options = ("PNG", _PNG) if suffix == ".png" else ("JPEG", {"quality": 95})
            if note:
                options = {**options, **_embedded(kind, json.dumps(dict(note)))}
            PillowImage.fromarray(levels).save(handle, kind, **options)

    return write


def check_depth(suffix: str, depth: int, *, floats: str = ".tif, .exr, or .npy") -> None:
    """Raise ValueError unless files with an ending may have a number of bits per value.

    The message proposes the endings of `floats`.
    """
    if depth not in (8, 16) or (depth == 16 and suffix != ".png"):
        raise ValueError(
            f"depth: expected 8, or 16 for .png, got {depth} for {suffix}; leave it out (--depth), "
            f"and choose {floats} for floats"
        )


def _embedded(kind: str, text: str) -> dict[str, Any]:
    """Return the options of Pillow that embed a text in a PNG or a JPEG."""
    if kind == "JPEG":
        return {"comment": text[:60_000].encode()}
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    info.add_text(KEYWORD, text)
    return {"pnginfo": info}


def read_note(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the note that :func:`image_writer` embedded in an image; {} without one.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.png"
    >>> image_writer(path, note={"method": "mle"})(path, np.zeros((4, 5)))
    >>> read_note(path)
    {'method': 'mle'}
    """
    path = Path(path)
    if path.suffix.lower() == ".png":
        return read_png_note(path)
    try:
        if path.suffix.lower() in (".tif", ".tiff"):
            with open_checked_tiff(path) as file:
                text = file.pages[0].description
        elif path.suffix.lower() == ".exr":
            text = read_exr_comments(path)
        else:
            from PIL import Image as PillowImage

            with PillowImage.open(path, formats=("JPEG",)) as image:
                text = image.info.get("comment", b"")
        content = json.loads(text)
    except Exception:  # any type: the file may be damaged, which its reader reports
        return {}
    return content if isinstance(content, dict) else {}


def display_levels(image: FloatImage, white: float, max_level: int) -> FloatImage:
    """Return integer levels from 0 to `max_level`; `white` and brighter become `max_level`."""
    if image.dtype == np.uint8 and white == max_level:
        return image
    levels = np.asarray(image / np.float64(white))
    np.clip(levels, 0, 1, out=levels)
    levels *= max_level
    return np.rint(levels, out=levels)
