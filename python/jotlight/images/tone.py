"""Tone curves: map intensities of any range to a display."""

import dataclasses
from collections.abc import Callable
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import FloatImage
from jotlight.parameter_names import check_choice

PERCENTILE = 99.5
"""Default percentile of the pixels that becomes white."""

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
