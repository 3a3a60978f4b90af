"""Checks of arguments: images of intensities, and numbers."""

import math
import operator
from typing import Any

import numpy as np
import numpy.typing as npt


def as_image(image: npt.ArrayLike) -> npt.NDArray[Any]:
    """Check an image of intensities; float32 or float64, and never copied when it is that already.

    Raises
    ------
    TypeError
        For integers and whatever else is not a real number with a known scale.
    ValueError
        For an image that is empty, negative, not finite, or not of 2 or 3 dimensions.
    """
    refuse_masked("image", image)
    array = np.asarray(image)
    if array.dtype.kind in "iub":
        raise TypeError(
            f"image: expected floats in units of intensity, got {array.dtype}, whose scale is "
            "unknown; divide by its white level, such as image / 255.0 for an 8-bit photograph"
        )
    if array.dtype.kind != "f":
        raise TypeError(f"image: expected floats, got {array.dtype}")
    if array.ndim not in (2, 3):
        raise ValueError(
            f"image: expected shape (H, W) or (H, W, C), got {array.ndim} dimensions {array.shape}"
        )
    if array.ndim == 3 and array.shape[2] > 4:
        raise ValueError(
            f"image: expected at most 4 colour channels in (H, W, C), got shape {array.shape}; "
            "expose the images of a stack one by one"
        )
    if array.size == 0:
        raise ValueError(f"image: expected at least one pixel, got shape {array.shape}")
    # NaN and infinity show in the extremes, and no array of the image's size is made to find them.
    low, high = array.min(), array.max()
    if not (np.isfinite(low) and np.isfinite(high)):
        raise ValueError("image: expected finite intensities, got NaN or infinity")
    if low < 0:
        raise ValueError(f"image: expected intensities of 0 or more, got {low}")
    if array.dtype not in (np.float32, np.float64):
        array = array.astype(np.float64 if array.dtype.itemsize > 4 else np.float32)
    return array if array.flags.aligned else array.copy()


def refuse_masked(name: str, data: object) -> None:
    """Raise TypeError for a masked array, whose mask would be lost."""
    if isinstance(data, np.ma.MaskedArray):
        raise TypeError(
            f"{name}: expected a plain array, got a masked one; fill it, and give the sensor a mask"
        )


def luma(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Grey of a colour image (H, W, 3), 0.299 R + 0.587 G + 0.114 B: ITU-R BT.601.

    Examples
    --------
    >>> luma(np.ones((2, 3, 3))).shape
    (2, 3)
    """
    return np.asarray(image @ np.array([0.299, 0.587, 0.114]))


def at_least(name: str, value: int, least: int) -> int:
    """Give a whole number that is not less than `least`.

    Raises
    ------
    TypeError, ValueError
        When it is no whole number, or less.

    Examples
    --------
    >>> at_least("steps", 3, 1)
    3
    """
    try:
        value = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected a whole number, got {value!r}") from None
    if value < least:
        raise ValueError(f"{name}: expected at least {least}, got {value}")
    return value


def above_0(name: str, value: float) -> float:
    """Give a finite number above 0.

    Raises
    ------
    ValueError
        When it is another one.

    Examples
    --------
    >>> above_0("rate", 1e-3)
    0.001
    """
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name}: expected a finite number above 0, got {value}")
    return value
