"""Maps of the jots of a sensor in files: numbers such as dark counts, and masks of dead jots."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.formats.images.captures import read_png, read_tiff
from jotlight.formats.npy.arrays import read_npy

MAP_ENDINGS = ".npy", ".tif", ".tiff"
"""Ends of the names of files that hold a map of numbers."""


def is_map(name: str) -> bool:
    """Return whether a name is that of a file with a map of numbers.

    Examples
    --------
    >>> is_map("dark.TIF"), is_map("0.01")
    (True, False)
    """
    return Path(name).suffix.lower() in MAP_ENDINGS


def read_map(path: str | Path) -> npt.NDArray[Any]:
    """Return the map of numbers in a `.npy` or TIFF file, one for each jot, (H, W).

    Raises
    ------
    OSError, ValueError
        When the file cannot be read. A TIFF file must hold a single image without colors.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "dark_counts.npy"
    >>> np.save(path, np.full((2, 3), 0.01))
    >>> read_map(path).shape
    (2, 3)
    """
    path = Path(path)
    if path.suffix.lower() == ".npy":
        return read_npy(path)
    _require_file(path)
    images = read_tiff(path)[0]
    if images.ndim != 3 or len(images) != 1:
        raise ValueError(
            f"{path}: expected a map of the jots, one image (H, W), got images of shape "
            f"{images.shape}"
        )
    return np.asarray(images.read(0, 1)[0])


def read_mask(path: Path) -> npt.NDArray[np.bool_]:
    """Return a mask of dead jots, (H, W), in which True marks a dead jot.

    Parameters
    ----------
    path : path
        A `.npy` file of booleans or whole numbers, or a grayscale PNG or TIFF. Every level above 0
        marks a dead jot.

    Raises
    ------
    OSError, ValueError
        When the file cannot be read, or has another ending.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "mask.npy"
    >>> np.save(path, np.eye(2, 3, dtype=bool))
    >>> read_mask(path).astype(int).tolist()
    [[1, 0, 0], [0, 1, 0]]
    """
    if is_map(path.name):
        mask = read_map(path)
    elif path.suffix.lower() == ".png":
        _require_file(path)
        mask = read_png(path)[0].read(0, 1)[0]
    else:
        raise ValueError(f"{path}: expected a mask in a .npy, .png, .tif, or .tiff file")
    if mask.dtype.kind in "iu" or path.suffix.lower() != ".npy":
        mask = mask != 0
    if mask.dtype == np.bool_ and mask.size and mask.mean() > 0.5:
        warn(
            f"{path}: marks {mask.mean():.0%} of the jots as dead; if it marks the live ones, "
            "invert it"
        )
    return mask


def _require_file(path: Path) -> None:
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
