"""The most probable curve of an affine motion in time, from noisy estimates of single blocks.

The engine searches for it, under the weights that make the estimates most probable (restricted
maximum likelihood).
"""

import functools

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import Array

_SYSTEMATIC_ERROR = 0.05
"""Standard deviation of the errors that do not depend on the number of photons, in pixels."""

_INTERPOLATION = 0.25
"""Error of linear interpolation between blocks, as a fraction of their second difference."""

_HALF = 0.5**0.5

_MODES: Array = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [0, 0, 0, 1, 0, 0],
        [0, _HALF, 0, 0, 0, _HALF],
        [0, 0, -_HALF, 0, _HALF, 0],
        [0, _HALF, 0, 0, 0, -_HALF],
        [0, 0, _HALF, 0, _HALF, 0],
    ]
)
"""Translations in rows and in columns, zoom, rotation, and two shears, in terms of the coefficients
of :func:`jotlight.motion.tiles.affine_basis`. The rows are orthonormal."""

_MIN_INFORMATION = 1e-6
"""Added information, relative to the mean, so that all systems are regular."""

_MIN_BLOCKS = 5
"""Fewer blocks are not smoothed."""


def smooth_affine(estimates: Array, information: Array, threads: int | None = None) -> Array:
    """Return the most probable curve of affine motions, (n, 6).

    A camera moves smoothly: the third differences of its translation are small, and its rotation
    and zoom change little. How little is not known, so the weights of these differences are those
    under which the estimates are most probable.

    Parameters
    ----------
    estimates : ndarray of float, shape (n, 6)
        Estimated coefficients of :func:`jotlight.motion.tiles.affine_basis` in each block, first
        for rows and then for columns.
    information : ndarray of float, shape (n, 6, 6)
        Information about them.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    if len(estimates) < _MIN_BLOCKS:
        return estimates.copy()
    # In these units, the mean information is 1.
    unit = max(float(np.trace(information, axis1=1, axis2=2).mean()) / 6, 1e-30) ** -0.5
    matrices = unit**2 * (_MODES @ information @ _MODES.T) + _MIN_INFORMATION * np.eye(6)
    curve = engine.smooth_curve(
        estimates @ _MODES.T / unit, matrices, ratios_of_differences(len(estimates)), threads
    )
    return np.asarray(unit * curve @ _MODES)


@functools.lru_cache(maxsize=4)
def ratios_of_differences(number: int) -> Array:
    """Return the squared third differences of the modes whose squared first differences are 1."""
    from scipy.linalg import eigh

    # Only constants have no differences. Without one value, the matrix of the first is regular.
    third, first = (_square_of_differences(number, order)[1:, 1:] for order in (3, 1))
    return np.asarray(np.maximum(eigh(third, first, eigvals_only=True), 0))


def _square_of_differences(number: int, order: int) -> Array:
    """Return ΔᵀΔ, (n, n), for differences of an order."""
    differences = np.diff(np.eye(number), order, axis=0)
    return np.asarray(differences.T @ differences)


def covariances_of(matrices: Array) -> Array:
    """Return the covariances of the parameters of all blocks, (n, 6, 6), from the information.

    All have the same shape. A smooth curve has less noise, but also a bias; they exceed both.
    """
    mean = matrices.mean(axis=0)
    mean += 1e-6 * np.trace(mean) * np.eye(6) + 1e-12 * np.eye(6)
    inverse = np.linalg.inv(mean)
    information = np.einsum("nij,ji->n", matrices, inverse) / 6
    return np.asarray(inverse / np.maximum(information, 1e-9)[:, None, None])


def information_of(covariances: Array, basis: Array, displacements: Array) -> Array:
    """Return the information about the displacements of tiles, (n, 3, tiles).

    The covariances (n, 6, 6) are those of the coefficients of the basis (tiles, 3). Between the
    blocks, the displacements (n, 2, tiles) are interpolated linearly, which adds an error.
    """
    blocks = covariances.reshape(-1, 2, 3, 2, 3).transpose(0, 1, 3, 2, 4).reshape(-1, 2, 2, 9)
    products = (basis[:, :, None] * basis[:, None, :]).reshape(-1, 9)
    variances = np.einsum("nabp,tp->nabt", blocks, products)
    curvature = np.zeros_like(displacements)
    curvature[1:-1] = np.diff(displacements, 2, axis=0)
    curvature[[0, -1]] = curvature[[1, -2]]
    variances[:, [0, 1], [0, 1]] += _SYSTEMATIC_ERROR**2 + (_INTERPOLATION * curvature) ** 2
    rows, mixed, columns = variances[:, 0, 0], variances[:, 0, 1], variances[:, 1, 1]
    determinant = rows * columns - mixed**2
    return np.asarray(np.stack([columns, -mixed, rows], axis=1) / determinant[:, None])
