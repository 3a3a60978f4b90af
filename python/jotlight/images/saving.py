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
from jotlight.sensing.bits import Bits

_DARK = 0.1
"""Images whose bright pixels are below this fraction of white are exposed automatically."""


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
    image : array_like, shape (H, W), (H, W, 1), or (H, W, 3)
        Intensities, counts, or one frame of bits.
    white : float, optional
        The value that becomes white in PNG and JPEG. Brighter pixels are white, too. Default: 1 for
        bool and floats, and the largest possible value of uint8 and uint16. Other integers, and
        images that exceed this value or are below a tenth of it, are exposed automatically, with a
        warning: white is about the 99.5th percentile.
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
    path = Path(path)
    if isinstance(image, Bits):
        raise TypeError(
            "image: expected an array, got Bits; take one frame, bits[0], or bits.counts()"
        )
    values = np.asarray(image)
    if values.dtype.kind not in "biuf":
        raise TypeError(f"image: expected an array of numbers, got {values.dtype}")
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if not (values.ndim == 2 or (values.ndim == 3 and values.shape[2] == 3)) or values.size == 0:
        raise ValueError(f"image: expected shape (H, W) or (H, W, 3), got {values.shape}")
    if path.suffix.lower() in DISPLAYED:
        if not np.isfinite(values).all():
            raise ValueError("image: expected finite values, got NaN or infinity")
        white = find_white(values) if white is None else white
        if not 0 < white < np.inf:
            raise ValueError(f"white: expected a finite value above 0, got {white}")
    write = image_writer(path, depth=depth, white=white or 1.0)
    if path.suffix.lower() != ".npy" and values.dtype != np.float64:
        values = values.astype(np.float32)
    with atomic_write(path) as temporary:
        write(temporary, values)


def find_white(values: npt.NDArray[Any]) -> float:
    """Return the value that :func:`save_image` shows as white if none is given.

    Examples
    --------
    >>> find_white(np.array([[0.2, 0.9]])), find_white(np.full((2, 2), 99, np.uint8))
    (1.0, 255.0)
    """
    if values.dtype == np.bool_:
        return 1.0
    full = float(np.iinfo(values.dtype).max) if values.dtype in (np.uint8, np.uint16) else 1.0
    bright, largest = float(np.percentile(values, PERCENTILE)), float(values.max())
    has_scale = values.dtype.kind == "f" or full > 1
    if has_scale and largest <= full and bright >= _DARK * full:
        return full
    # A few bright pixels must not make an ordinary image brighter.
    white = max(bright, full) if has_scale and largest > full else bright
    if white <= 0:
        white = largest if largest > 0 else full
    percentile = f", the {PERCENTILE}th percentile," if white == bright else ""
    warn(f"image: {white:.3g}{percentile} is shown as white; white= sets another value")
    return white
