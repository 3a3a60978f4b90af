"""Tone curves: map intensities of any range to a display, whose white is stated or found."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import FloatImage
from jotlight.errors import warn
from jotlight.parameter_names import check_choice

PERCENTILE = 99.5
"""Default percentile of the pixels that becomes white."""

_DARK = 0.1
"""Images whose bright pixels are below this fraction of white are exposed automatically."""

_SHADES = 1000.0
"""Ratio of white to the level below which the curve ``log`` is nearly linear."""

_KEY = 0.18
"""Linear displayed value of the geometric mean in the curve of Reinhard et al."""


def _linear(x: FloatImage, middle: float) -> FloatImage:
    return x


def _gamma(x: FloatImage, middle: float) -> FloatImage:
    return np.asarray(x ** (1 / 2.2))


def _log(x: FloatImage, middle: float) -> FloatImage:
    return np.asarray(np.log1p(_SHADES * x) / np.log1p(_SHADES))


def _reinhard(x: FloatImage, middle: float) -> FloatImage:
    # White, x = 1, becomes _KEY / middle.
    scaled, white = x * (_KEY / middle), _KEY / middle
    return np.asarray(scaled * (1 + scaled / white**2) / (1 + scaled)) ** (1 / 2.2)


CURVES: dict[str, Callable[[FloatImage, float], FloatImage]] = {
    "linear": _linear,
    "gamma": _gamma,
    "log": _log,
    "reinhard": _reinhard,
}
"""Curves by name: functions of x = c / white in [0, 1], and of the geometric mean of x."""


@dataclasses.dataclass(frozen=True)
class Tone:
    """A curve from intensities to the display, [0, 1].

    With x = c / `white`, clipped to [0, 1]:

    - ``linear``: x
    - ``gamma``: x^(1/2.2)
    - ``log``: log(1 + 1000 x) / log(1001)
    - ``reinhard``: (y (1 + y / w²) / (1 + y))^(1/2.2) with y = 0.18 x / m, w = 0.18 / m and m the
      geometric mean of x

    All channels of a color image use the same curve.

    Parameters
    ----------
    curve : str
        The name of the curve.
    white : float
        The intensity that becomes white.
    middle : float
        The geometric mean m of x. Only ``reinhard`` uses it.

    Notes
    -----
    ``reinhard`` is the global curve of Reinhard et al. (2002), their equations (2) and (4). A
    gamma curve for the display follows it.

    Examples
    --------
    >>> Tone("gamma", white=100.0)(np.array([[0.0, 1.0, 100.0, 1e6]])).round(3)
    array([[0.   , 0.123, 1.   , 1.   ]], dtype=float32)
    """

    curve: str = "gamma"
    white: float = 1.0
    middle: float = _KEY

    def __post_init__(self) -> None:
        check_curve(self.curve)
        if not (0 < self.white < np.inf and 0 < self.middle < np.inf):
            raise ValueError(
                f"white and middle: expected finite numbers above 0, got {self.white} "
                f"and {self.middle}"
            )

    @classmethod
    def fit(
        cls,
        image: FloatImage,
        curve: str = "gamma",
        *,
        percentile: float = PERCENTILE,
        white: float | None = None,
    ) -> Self:
        """Return a tone for an image: white is a percentile of it, and middle its geometric mean.

        `white` replaces the percentile.

        Examples
        --------
        >>> Tone.fit(np.linspace(0, 50, 101), "linear", percentile=80).white
        40.0
        """
        if not 0 < percentile <= 100:
            raise ValueError(f"percentile: expected a number in (0, 100], got {percentile}")
        if white is None:
            white = float(np.percentile(image, percentile)) or float(np.max(image)) or 1.0
        # Black pixels would make the geometric mean 0.
        x = np.clip(np.asarray(image, np.float64) / white, 1e-4, 1)
        return cls(curve, white, float(np.exp(np.log(x).mean())))

    def __call__(self, image: FloatImage) -> npt.NDArray[np.float32]:
        """Return the displayed image: values in [0, 1], in the same shape."""
        x = np.clip(np.asarray(image, np.float64) / self.white, 0, 1)
        return np.clip(CURVES[self.curve](x, self.middle), 0, 1).astype(np.float32)


def check_curve(name: str) -> None:
    """Raise ValueError if the curve is unknown."""
    check_choice("curve", name, CURVES)


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
