"""The type of images, their channels in files, and the conversion of color to gray."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import FloatImage
from jotlight.errors import warn


def luma(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the gray of a color image (H, W, 3): 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601).

    Examples
    --------
    >>> luma(np.ones((2, 3, 3))).shape
    (2, 3)
    """
    return np.asarray(image @ np.array([0.299, 0.587, 0.114]))


def drop_transparency(path: Path, images: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return images (..., H, W, C) without their last channel, which is the transparency.

    Warns if a pixel is not opaque.

    Examples
    --------
    >>> drop_transparency(Path("a.png"), np.ones((2, 3, 4))).shape
    (2, 3, 3)
    """
    warn_about_transparent_pixels(path, images[..., -1])
    return images[..., :-1]


def warn_about_transparent_pixels(path: Path, alpha: npt.NDArray[Any]) -> None:
    """Warn if a channel of transparency, which is dropped, contains pixels that are not opaque.

    A channel of bool is True at opaque pixels.
    """
    opaque = np.iinfo(alpha.dtype).max if alpha.dtype.kind in "iu" else 1
    number = np.count_nonzero(alpha < opaque)
    if number:
        warn(
            f"{path}: {number} of {alpha.size} pixels are transparent; the transparency is "
            "dropped, so they have the colors that the file stores below it"
        )


def fit_channels(path: Path, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an image with channels that a file with the ending of `path` can hold.

    A `.npy` holds any array. In other files, a single channel (H, W, 1) becomes a gray image.

    Raises
    ------
    ValueError
        For two or four channels, unless the file is a `.npy` or a TIFF. Programs would take the
        last of them for transparency.

    Examples
    --------
    >>> fit_channels(Path("a.png"), np.ones((2, 3, 1))).shape
    (2, 3)
    """
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return image
    if image.shape[2:] == (1,):
        return image[..., 0]
    if image.shape[2:] not in ((), (3,)) and suffix not in (".tif", ".tiff"):
        raise ValueError(
            f"{path}: expected a gray image or three channels, got {image.shape[2]} channels; .npy "
            "and .tif hold them"
        )
    return image


def check_sides(image: FloatImage, suffix: str, largest: int) -> None:
    """Raise ValueError if an image has more rows or columns than films with an ending can have.

    Examples
    --------
    >>> check_sides(np.zeros((2, 9)), ".gif", 8)
    Traceback (most recent call last):
      ...
    ValueError: images: expected up to 8 rows and columns for a .gif, got 2 x 9; write a .tif or ...
    """
    height, width = image.shape[:2]
    if max(height, width) > largest:
        raise ValueError(
            f"images: expected up to {largest} rows and columns for a {suffix}, got {height} x "
            f"{width}; write a .tif or .npy, or smaller images"
        )
