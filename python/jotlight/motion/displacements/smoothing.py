"""Smooth curves through the displacements of all blocks."""

import numpy as np

from jotlight.array_types import Array

_ORDER = 3
"""Order of the differences that are small if a curve is smooth."""

_PENALTIES = np.logspace(-3, 8, 56)
"""Weights of the squared differences, among which one is selected."""

_TOLERANCE = 1.3
"""Maximum ratio of the squared residuals of the curve to those of noise."""

_MAX_EXCESS = 10.0
"""Largest assumed ratio of the variance of the noise to the inverse of the information."""


def smoothing_matrix(series: Array, information: Array) -> Array:
    """Return the matrix S, (n, n), for which S y is a smooth curve through y.

    The curve is as smooth as possible, as long as its residuals are like noise.

    Parameters
    ----------
    series : ndarray of float, shape (n, m)
        m series of n values, in units in which their information is equal.
    information : ndarray of float, shape (n,)
        Inverse variance of the values in each row.

    Examples
    --------
    >>> line = np.arange(9.0)[:, None]
    >>> bool(abs(smoothing_matrix(line, np.ones(9)) @ line - line).max() < 1e-9)
    True
    """
    number = len(series)
    roots = np.sqrt(np.maximum(information, 1e-6 * information.max() + 1e-30))
    differences = np.diff(np.eye(number), _ORDER, axis=0) / roots
    # All smoothing matrices have the same eigenvectors in these units.
    values, vectors = np.linalg.eigh(differences.T @ differences)
    values = np.maximum(values, 0) * (roots**2).mean()
    values[:_ORDER] = 0  # parabolas have no such differences, so rounding must not add any
    rotated = (vectors.T @ (roots[:, None] * series)) ** 2
    # The roughest half of the components is noise, which may exceed the stated one.
    rough = float(rotated[number // 2 :].mean())
    excess = float(np.clip(rough, 1, _MAX_EXCESS))
    kept = np.ones(number)
    for penalty in _PENALTIES:
        removed = 1 - 1 / (1 + penalty * values)
        noise = excess * series.shape[1] * (removed**2).sum()
        if (removed[:, None] ** 2 * rotated).sum() > _TOLERANCE * noise:
            break
        kept = 1 - removed
    return np.asarray((vectors * kept) @ vectors.T * roots / roots[:, None])


def cubic_weights(number: int, place: float, bias: float = 0.0) -> Array:
    """Return the weights of `number` values whose sum is a cubic through the four nearest.

    Parameters
    ----------
    number : int
        Number of values.
    place : float
        Where the cubic is evaluated: 0 for the first value, number - 1 for the last one.
    bias : float
        By which multiple of its second difference the curve exceeds the values.

    Examples
    --------
    >>> round(float(cubic_weights(8, 2.5) @ np.arange(8) ** 3), 6)
    15.625
    """
    first = int(np.clip(np.floor(place) - 1, 0, max(0, number - 4)))
    nearest = np.arange(first, min(first + 4, number))
    weights = np.zeros(number)
    for index in nearest:
        others = nearest[nearest != index]
        weights[index] = np.prod((place - others) / (index - others))
    if len(nearest) == 4:
        # The second difference is linear in time.
        fraction = place - nearest[1]
        weights[nearest] += bias * (1 - fraction) * np.array([1, -2, 1, 0])
        weights[nearest] += bias * fraction * np.array([0, 1, -2, 1])
    return weights


def interpolation_bias(frames: int) -> float:
    """Return by which multiple of its second difference a curve exceeds the values of blocks.

    Between the centers of blocks, displacements are interpolated linearly. The estimate of a block
    makes their mean over its frames right, so the value in its center is too small where the curve
    has a positive second difference.

    Parameters
    ----------
    frames : int
        Number of frames of each block.

    Examples
    --------
    >>> [round(interpolation_bias(frames), 3) for frames in (1, 4, 1000)]
    [0.0, 0.086, 0.083]
    """
    offsets = abs(np.arange(frames) - (frames - 1) / 2) / frames
    return float(np.mean(offsets - offsets**2) / 2)
