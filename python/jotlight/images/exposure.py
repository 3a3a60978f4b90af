"""The white of images for display that state none, and their tone curve."""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.images.tone import PERCENTILE, Tone

_DARK = 0.1
"""Images whose bright pixels are below this fraction of white are exposed automatically."""


class Exposure(NamedTuple):
    """How an image is shown. The larger one of two suits both."""

    is_lit: bool
    white: float
    is_clipped: bool
    """Whether pixels are brighter than white, or white is not the full scale."""
    is_percentile: bool = False

    def report(self, name: str) -> None:
        """Warn about white unless it is the full scale."""
        if self.is_clipped:
            percentile = f", the {PERCENTILE}th percentile," if self.is_percentile else ""
            warn(
                f"{name}: {self.white:.3g}{percentile} is shown as white; white= (--white) sets "
                "another value"
            )


def display_tone(
    image: npt.NDArray[Any], curve: str | None, white: float | None, name: str = "image"
) -> Tone:
    """Return the tone curve of an estimate in a .png or .jpg.

    Without a white, a requested curve has the 99.5th percentile, and the linear curve has that of
    :func:`find_white`, whose warning calls the image `name`.

    Examples
    --------
    >>> display_tone(np.array([[0.2, 0.9]], np.float32), None, None)
    Tone(curve='linear', white=1.0, middle=0.18)
    """
    if curve is not None:
        return Tone.fit(image, curve, white=white)
    return Tone("linear", find_white(image, name) if white is None else white)


def find_white(values: npt.NDArray[Any], name: str = "image") -> float:
    """Return the value that :func:`jotlight.save_image` shows as white if none is given.

    A warning states it, if it is not the full scale, and calls the image `name`.

    Examples
    --------
    >>> find_white(np.array([[0.2, 0.9]])), find_white(np.full((2, 2), 99, np.uint8))
    (1.0, 255.0)
    """
    exposure = expose(values)
    exposure.report(name)
    return exposure.white


def expose(values: npt.NDArray[Any]) -> Exposure:
    """Return how an image of any kind of number is shown.

    Examples
    --------
    >>> expose(np.array([[0.2, 0.9]])).white
    1.0
    """
    if values.dtype == np.bool_:
        return Exposure(True, 1.0, False)
    full = float(np.iinfo(values.dtype).max) if values.dtype in (np.uint8, np.uint16) else 1.0
    largest, has_scale = float(values.max()), values.dtype.kind == "f" or full > 1
    # In most images, counting the bright pixels suffices, which is faster than the percentile.
    limit = math.ceil(_DARK * full) if full > 1 else _DARK  # whole, so that NumPy converts nothing
    number = np.count_nonzero(values > limit)
    if has_scale and largest <= full and number > (1 - PERCENTILE / 100) * values.size + 1:
        return Exposure(True, full, False)
    bright = float(np.percentile(values, PERCENTILE))
    if has_scale and largest <= full and bright >= _DARK * full:
        return Exposure(True, full, False)
    # A few bright pixels must not make an ordinary image brighter.
    white = max(bright, full) if has_scale and largest > full else bright
    if white <= 0:
        white = largest if largest > 0 else full
    return Exposure(largest > 0, white, True, white == bright)
