"""Tone curves: float pictures of any range made visible on a display."""

import dataclasses
from collections.abc import Callable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

Picture = npt.NDArray[np.floating[Any]]

PERCENTILE = 99.5
"""Of the pixels so many are no brighter than white, unless told otherwise."""

_SHADES = 1000.0
"""How much darker than white the logarithmic curve goes before it is nearly linear."""

_KEY = 0.18
"""What the middle brightness becomes in the curve of Reinhard et al."""


def _linear(x: Picture, middle: float) -> Picture:
    return x


def _gamma(x: Picture, middle: float) -> Picture:
    return np.asarray(x ** (1 / 2.2))


def _log(x: Picture, middle: float) -> Picture:
    return np.asarray(np.log1p(_SHADES * x) / np.log1p(_SHADES))


def _reinhard(x: Picture, middle: float) -> Picture:
    # White is x = 1, and so _KEY / middle after the scaling.
    scaled, white = x * (_KEY / middle), _KEY / middle
    return np.asarray(scaled * (1 + scaled / white**2) / (1 + scaled)) ** (1 / 2.2)


CURVES: dict[str, Callable[[Picture, float], Picture]] = {
    "linear": _linear,
    "gamma": _gamma,
    "log": _log,
    "reinhard": _reinhard,
}
"""The curves, from x = c / white in [0, 1] and its middle brightness."""


@dataclasses.dataclass(frozen=True)
class Tone:
    """A curve from intensities to the display, [0, 1].

    With x = c / `white`, what is brighter than white being white:

    - ``linear``: x
    - ``gamma``: x^(1/2.2)
    - ``log``: log(1 + 1000 x) / log(1001)
    - ``reinhard``: (y (1 + y / w²) / (1 + y))^(1/2.2) with y = 0.18 x / m, w = 0.18 / m and m the
      geometric mean of x

    Channels of a colour picture are treated alike.

    Notes
    -----
    The last is the global curve of Reinhard et al. (2002), their equations (2) and (4), followed
    by the display's gamma.

    Examples
    --------
    >>> Tone("gamma", white=100.0)(np.array([[0.0, 1.0, 100.0, 1e6]])).round(3)
    array([[0.   , 0.123, 1.   , 1.   ]], dtype=float32)
    """

    curve: str = "gamma"
    white: float = 1.0
    """The intensity that becomes white."""
    middle: float = _KEY
    """m, which only ``reinhard`` looks at."""

    def __post_init__(self) -> None:
        check_curve(self.curve)
        if not (0 < self.white < np.inf and 0 < self.middle < np.inf):
            raise ValueError(
                f"white and middle: expected finite numbers above 0, got {self.white} "
                f"and {self.middle}"
            )

    @classmethod
    def fit(cls, picture: Picture, curve: str = "gamma", *, percentile: float = PERCENTILE) -> Self:
        """Choose white so that a share of the values is no brighter, and the middle likewise.

        Examples
        --------
        >>> Tone.fit(np.linspace(0, 50, 101), "linear", percentile=80).white
        40.0
        """
        if not 0 < percentile <= 100:
            raise ValueError(f"percentile: expected a number in (0, 100], got {percentile}")
        white = float(np.percentile(picture, percentile)) or float(np.max(picture)) or 1.0
        # Black pixels would make the geometric mean 0.
        x = np.clip(np.asarray(picture, np.float64) / white, 1e-4, 1)
        return cls(curve, white, float(np.exp(np.log(x).mean())))

    def __call__(self, picture: Picture) -> npt.NDArray[np.float32]:
        """Apply the curve: values in [0, 1], of the picture's shape."""
        x = np.clip(np.asarray(picture, np.float64) / self.white, 0, 1)
        return np.clip(CURVES[self.curve](x, self.middle), 0, 1).astype(np.float32)


def check_curve(name: str) -> None:
    """Raise ValueError for a curve that is not known."""
    if name not in CURVES:
        raise ValueError(f"curve: expected one of {', '.join(CURVES)}, got {name!r}")
