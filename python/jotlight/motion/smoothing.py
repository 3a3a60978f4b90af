"""Smooth curves through the displacements of all blocks."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_ORDER = 3
"""Order of the differences that are small if a curve is smooth."""

_PENALTIES = np.logspace(-3, 7, 41)
"""Weights of the squared differences, among which cross-validation selects one."""


def smoothing_weights(series: Array, place: float) -> Array:
    """Return weights w for which w · y is the value of a smooth curve through y at a place.

    The strength of the smoothing is the one that predicts omitted values of the series best:
    generalized cross-validation.

    Parameters
    ----------
    series : ndarray of float, shape (n, m)
        m series of n values at the places 0, 1, ..., n - 1, which select the strength.
    place : float
        Place from 0 to n - 1, between which the curve is interpolated by a cubic.

    Examples
    --------
    >>> line = np.arange(9.0)[:, None]
    >>> round(float(smoothing_weights(line, 4.25) @ line[:, 0]), 6)
    4.25
    """
    number = len(series)
    differences = np.diff(np.eye(number), _ORDER, axis=0)
    # All smoothing matrices have the same eigenvectors.
    values, vectors = np.linalg.eigh(differences.T @ differences)
    values = np.maximum(values, 0)
    rotated = vectors.T @ series
    best, least = np.ones(number), np.inf
    for penalty in _PENALTIES:
        kept = 1 / (1 + penalty * values)
        residual = ((1 - kept)[:, None] * rotated) ** 2
        score = residual.sum() / (number - kept.sum()) ** 2
        if score < least:
            best, least = kept, score
    return _cubic_weights(number, place) @ (vectors * best) @ vectors.T


def _cubic_weights(number: int, place: float) -> Array:
    """Return the weights of the four nearest of `number` values, for a cubic through them."""
    first = int(np.clip(np.floor(place) - 1, 0, max(0, number - 4)))
    nearest = np.arange(first, min(first + 4, number))
    weights = np.zeros(number)
    for index in nearest:
        others = nearest[nearest != index]
        weights[index] = np.prod((place - others) / (index - others))
    return weights
