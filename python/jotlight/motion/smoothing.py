"""Smooth curves through the displacements of all blocks."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_ORDER = 3
"""Order of the differences that are small if a curve is smooth."""

_PENALTIES = np.logspace(-3, 8, 56)
"""Weights of the squared differences, among which one is selected."""

_TOLERANCE = 1.5
"""Maximum ratio of the squared residuals of the curve to those of noise."""


def smoothing_weights(series: Array, variances: Array, place: float) -> Array:
    """Return weights w for which w · y is the value of a smooth curve through y at a place.

    The curve is as smooth as possible, as long as its residuals are like noise.

    Parameters
    ----------
    series : ndarray of float, shape (n, m)
        m series of n values at the places 0, 1, ..., n - 1.
    variances : ndarray of float, shape (m,)
        Variance of the noise of each series.
    place : float
        Place from 0 to n - 1. Between whole numbers, the curve is interpolated by a cubic.

    Examples
    --------
    >>> line = np.arange(9.0)[:, None]
    >>> round(float(smoothing_weights(line, np.ones(1), 4.25) @ line[:, 0]), 6)
    4.25
    """
    number = len(series)
    differences = np.diff(np.eye(number), _ORDER, axis=0)
    # All smoothing matrices have the same eigenvectors.
    values, vectors = np.linalg.eigh(differences.T @ differences)
    rotated = (vectors.T @ series) ** 2 / variances
    kept = np.ones(number)
    for penalty in _PENALTIES:
        removed = 1 - 1 / (1 + penalty * np.maximum(values, 0))
        noise = series.shape[1] * (removed**2).sum()
        if (removed[:, None] ** 2 * rotated).sum() > _TOLERANCE * noise:
            break
        kept = 1 - removed
    return np.asarray(_cubic_weights(number, place) @ (vectors * kept) @ vectors.T)


def _cubic_weights(number: int, place: float) -> Array:
    """Return the weights of the four nearest of `number` values, for a cubic through them."""
    first = int(np.clip(np.floor(place) - 1, 0, max(0, number - 4)))
    nearest = np.arange(first, min(first + 4, number))
    weights = np.zeros(number)
    for index in nearest:
        others = nearest[nearest != index]
        weights[index] = np.prod((place - others) / (index - others))
    return weights
