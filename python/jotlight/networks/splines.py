"""Cubic B-splines: their basis, and the coefficients of some functions."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]
Function = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]]

# No array: torch.compile would take it for a tensor.
CUBIC_BASIS = (1, -3, 3, -1), (4, 0, -6, 3), (1, 3, 3, -3), (0, 0, 0, 1)
"""Six times the four cubic B-splines past a knot, in powers of the distance past it."""


def relu_spline(low: float, high: float, number: int) -> Array:
    """Coefficients (1, N_w) of a spline that is nearly max(z, 0)."""
    places = np.linspace(low, high, number - 2)
    spacing = places[1] - places[0]
    every = np.concatenate([[places[0] - spacing], places, [places[-1] + spacing]])
    coefficients: Array = np.maximum(every, 0)[None].astype(np.float32)
    return coefficients


def identity_spline(most: float) -> tuple[Array, float, float]:
    """Coefficients, start and spacing of a spline that is z between 0 and `most`."""
    return (most * np.array([[-1, 0, 1, 2]])).astype(np.float32), 0.0, most


def fit_spline(
    function: Function,
    low: float,
    high: float,
    number: int,
) -> tuple[Array, float, float]:
    """Coefficients (1, number), start and spacing of the least-squares spline on [low, high]."""
    from scipy.interpolate import make_lsq_spline

    spacing = (high - low) / (number - 3)
    knots = low + spacing * (np.arange(number + 4) - 3)
    # Eight samples to an interval, kept inside where rounding might put the last one out.
    samples = np.linspace(low, high, 8 * (number - 3) + 1).clip(knots[3], knots[-4])
    spline = make_lsq_spline(samples, function(samples), knots, k=3)
    return spline.c[None].astype(np.float32), float(low), float(spacing)
