"""The most probable curve of an affine motion in time, from noisy estimates of single blocks.

The engine searches for it, under the weights that make the estimates most probable (restricted
maximum likelihood).
"""

import functools

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine

Array = npt.NDArray[np.float64]

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
