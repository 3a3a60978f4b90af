"""Images of counts in TIFF and PNG, one or many, and masks."""

import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.formats.arrays import read_npy
from jotlight.formats.capture import Capture, as_count_stack, is_single_image, pack_lazily
from jotlight.formats.limits import check_claimed_size
from jotlight.formats.raw import list_files
from jotlight.formats.tiff import open_checked_tiff
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, concatenate
from jotlight.sensing.provenance import Provenance

_EXPANDED = {2: 85, 4: 17}
"""By what Pillow multiplies grey levels of so many bits, to fill eight."""


def open_tiff(path: Path) -> Capture:
    """Open a TIFF, or a folder of them in natural order."""
    return _images(path, (".tif", ".tiff"), "tiff", _tiff_frames)


def open_png(path: Path) -> Capture:
    """Open a grey PNG, or a folder of them in natural order; one bit deep, they are bits."""
    return _images(path, (".png",), "png", _png_frames)


def _images(
    path: Path,
    endings: tuple[str, ...],
    name: str,
    read: Callable[[Path], tuple[Frames, str | None]],
) -> Capture:
    files = list_files(path, endings, name.upper())
    parts, labels = zip(*map(read, files), strict=True)
    if len({(part.shape[1:], part.dtype) for part in parts}) != 1:
        raise ValueError(f"{path}: expected images of one size and type")
    provenance = Provenance(name, path.name)
    if len(files) > 1:
        provenance = provenance.with_notes(
            f"{len(files)} files in the natural order of their names"
        )
    frames = concatenate(parts)
    if frames.dtype == np.bool_ and frames.ndim == 3:
        provenance = provenance.with_notes(
            "black and white pictures are frames of bits, white for 1"
        )
        return Bits(pack_lazily(frames, path.name), frames.shape[2], provenance=provenance)
    return as_count_stack(frames, provenance, labels[0] if len(files) == 1 else None)


def _tiff_frames(path: Path) -> tuple[Frames, str | None]:
    try:
        with open_checked_tiff(path) as file:
            series = file.series[0]
            shape, dtype = series.shape, series.dtype
            told = file.pages[0].description
            check_claimed_size("the header", series.size * dtype.itemsize, path.stat().st_size)
            single = is_single_image(shape)
            paged = not single and len(series.pages) == shape[0]
    except Exception as error:  # anything: tifffile does not check what it reads
        raise ValueError(f"{path}: the TIFF file cannot be read ({error})") from error
    if len(shape) not in (2, 3, 4) or dtype.kind not in "biu":
        raise ValueError(
            f"{path}: expected counts in whole numbers, (H, W) or (T, H, W), got {dtype} of "
            f"shape {shape}; floats are a picture"
        )

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        try:
            with open_checked_tiff(path) as file:
                series = file.series[0]
                if not paged:
                    return np.asarray(series.asarray().reshape(full)[start:stop])
                out = np.empty((stop - start, *shape[1:]), dtype)
                for index in range(start, stop):
                    page: Any = series.pages[index]
                    _check_page(page, shape[1:], path)
                    out[index - start] = page.asarray()
                return out
        except Exception as error:
            raise ValueError(f"{path}: the TIFF file is damaged ({error})") from error

    full = (1, *shape) if single else shape
    return Frames(full, read, dtype.newbyteorder("=")), told


def _check_page(page: Any, shape: tuple[int, ...], path: Path) -> None:
    """Raise ValueError unless a page is as its series says, and so are its tiles."""
    if math.prod(page.shape) != math.prod(shape):
        raise ValueError(f"expected pages of shape {shape}, got {page.shape}")
    like = page.keyframe
    tile = like.tilewidth * like.tilelength * max(1, like.tiledepth) * like.dtype.itemsize
    check_claimed_size("a tile", tile, path.stat().st_size)


def _png_frames(path: Path) -> tuple[Frames, None]:
    from PIL import Image

    def load() -> npt.NDArray[Any]:
        with path.open("rb") as file:
            head = file.read(26)
        if head[:8] != b"\x89PNG\r\n\x1a\n" or len(head) < 26:
            raise ValueError("it does not begin like a PNG")
        width, height = (int.from_bytes(head[at : at + 4], "big") for at in (16, 20))
        depth, colour = head[24], head[25]
        # Indices into a palette are levels too, which a program has painted.
        if colour not in (0, 3):
            raise ValueError("expected grey levels, got colour or transparency")
        check_claimed_size("the header", width * height * max(1, depth // 8), path.stat().st_size)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with Image.open(path) as image:
                array = np.asarray(image)
        if array.shape != (height, width):
            raise ValueError(f"expected {height} x {width} levels, got {array.shape}")
        if colour == 0 and depth in _EXPANDED:
            array = array // _EXPANDED[depth]
        return array[None]

    def said() -> npt.NDArray[Any]:
        try:
            return load()
        except (OSError, ValueError, SyntaxError, Warning, Image.DecompressionBombError) as error:
            if isinstance(error, FileNotFoundError):
                raise
            raise ValueError(f"{path}: the PNG cannot be read as counts ({error})") from error

    first = said()
    return Frames(first.shape, lambda start, stop: said()[start:stop], first.dtype), None


def read_mask(path: Path) -> npt.NDArray[np.bool_]:
    """Read a map of dead jots: bool in a `.npy`, or a grey PNG where all but black is dead."""
    if path.suffix.lower() != ".png":
        mask = np.array(read_npy(path))
    else:
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {path}")
        mask = _png_frames(path)[0].read(0, 1)[0] != 0
    if mask.dtype == np.bool_ and mask.size and mask.mean() > 0.5:
        warn(
            f"{path}: marks {mask.mean():.0%} of the jots as dead; if it marks the good ones, "
            "invert it"
        )
    return mask
