"""Images of any kind of number in one call, as a file for display or for measurements."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.files import atomic_write
from jotlight.images.io import DISPLAYED, image_writer
from jotlight.images.tone import PERCENTILE

_DARK = 0.1
"""Images whose bright pixels are below this are exposed automatically."""


def save_image(
    path: str | os.PathLike[str],
    image: npt.ArrayLike,
    *,
    white: float | None = None,
    depth: int = 8,
) -> None:
    """Write an image to a file, completely or not at all.

    Parameters
    ----------
    path : path
        The ending chooses the format: `.png` and `.jpg` for display; `.tif` and `.exr` (float32)
        and `.npy` for numbers, which are never clipped.
    image : array_like, shape (H, W) or (H, W, 3)
        Intensities, counts, or bits.
    white : float, optional
        The value that becomes white in PNG and JPEG. Brighter pixels are white, too. Default: 1 for
        intensities in [0, 1] and bits, and the largest value of uint8 and uint16. Counts, and
        intensities that are all below 0.1 or exceed 1, are exposed automatically, with a warning:
        white is the 99.5th percentile.
    depth : {8, 16}
        Bits per value of a PNG.

    Raises
    ------
    TypeError, ValueError
        When the image, the name, or an option is not of the kind above.
    OSError
        When the file cannot be written.

    Warns
    -----
    JotlightWarning
        When the image is exposed automatically.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "ramp.png"
    >>> save_image(path, np.linspace(0, 1, 12).reshape(3, 4))
    >>> path.stat().st_size > 50
    True
    """
    path, values = Path(path), np.asarray(image)
    if values.dtype.kind not in "biuf":
        raise TypeError(f"image: expected an array of numbers, got {values.dtype}")
    if not (values.ndim == 2 or (values.ndim == 3 and values.shape[2] == 3)) or values.size == 0:
        raise ValueError(f"image: expected shape (H, W) or (H, W, 3), got {values.shape}")
    if path.suffix.lower() in DISPLAYED:
        if not np.isfinite(values).all():
            raise ValueError("image: expected finite values, got NaN or infinity")
        white = find_white(values) if white is None else white
        if not 0 < white < np.inf:
            raise ValueError(f"white: expected a finite value above 0, got {white}")
    write = image_writer(path, depth=depth, white=white or 1.0)
    with atomic_write(path) as temporary:
        write(temporary, values if values.dtype == np.float64 else values.astype(np.float32))


def find_white(values: npt.NDArray[Any]) -> float:
    """Return the value that :func:`save_image` shows as white if none is given.

    Examples
    --------
    >>> find_white(np.array([[0.2, 0.9]])), find_white(np.zeros((2, 2), np.uint8))
    (1.0, 255.0)
    """
    if values.dtype == np.bool_:
        return 1.0
    if values.dtype in (np.uint8, np.uint16):
        return float(np.iinfo(values.dtype).max)
    bright = float(np.percentile(values, PERCENTILE))
    if values.dtype.kind == "f" and values.max() <= 1 and bright >= _DARK:
        return 1.0
    white = bright if bright > 0 else max(float(values.max()), 0) or 1.0
    warn(f"image: {white:.3g}, the {PERCENTILE}th percentile, is shown as white; white= sets it")
    return white
