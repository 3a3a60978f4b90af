"""Cubic B-splines: their basis, and the coefficients that represent a function."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

ScalarFunction = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]]
Spline = tuple[npt.NDArray[np.float32], float, float]
"""Coefficients (1, N_w), first knot, and knot spacing, in the order of `Layer`'s parameters."""

# Tuples, because torch.compile would trace an array as a tensor.
CUBIC_BASIS = (1, -3, 3, -1), (4, 0, -6, 3), (1, 3, 3, -3), (0, 0, 0, 1)
"""The four cubic B-splines that are nonzero between two knots, times 6.

Each row holds the coefficients of 1, t, t², and t³, where t in [0, 1) is the distance from the
lower knot in units of the spacing.
"""


def relu_spline(low: float, high: float, number: int) -> Spline:
    """Return a spline with `number` coefficients that is nearly max(z, 0) on [low, high].

    Examples
    --------
    >>> relu_spline(-1.0, 1.0, 5)[0].tolist()
    [[0.0, 0.0, 0.0, 1.0, 2.0]]
    """
    knots = np.linspace(low, high, number - 2)
    spacing = knots[1] - knots[0]
    centers = np.concatenate([[knots[0] - spacing], knots, [knots[-1] + spacing]])
    coefficients = np.maximum(centers, 0)[None].astype(np.float32)
    return coefficients, low, (high - low) / (number - 3)


def identity_spline(high: float) -> Spline:
    """Return a spline that is z on [0, high].

    Examples
    --------
    >>> identity_spline(2.0)[0].tolist()
    [[-2.0, 0.0, 2.0, 4.0]]
    """
    return (high * np.array([[-1, 0, 1, 2]])).astype(np.float32), 0.0, high


def fit_spline(function: ScalarFunction, low: float, high: float, number: int) -> Spline:
    """Return the least-squares spline of a function on [low, high], with `number` coefficients.

    Examples
    --------
    >>> fit_spline(lambda z: 2 * z + 3, 0.0, 1.0, 4)[0].round(3).tolist()
    [[1.0, 3.0, 5.0, 7.0]]
    """
    from scipy.interpolate import make_lsq_spline

    spacing = (high - low) / (number - 3)
    knots = low + spacing * (np.arange(number + 4) - 3)
    # Eight samples per interval. Rounding may move the ends past the outer knots; clip undoes it.
    samples = np.linspace(low, high, 8 * (number - 3) + 1).clip(knots[3], knots[-4])
    spline = make_lsq_spline(samples, function(samples), knots, k=3)
    return spline.c[None].astype(np.float32), float(low), float(spacing)
