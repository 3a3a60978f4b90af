"""The most probable curve of an affine motion in time, from noisy estimates of single blocks.

A camera moves smoothly: the third differences of its translation are small, and its rotation and
zoom change little. How little is not known, so the weights of these differences are those under
which the estimates are most probable (restricted maximum likelihood).
"""

import dataclasses
import functools
from typing import Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

Weights = tuple[float, ...]
"""Logarithms of the weights of the squared differences of each term."""

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

_TRANSLATIONS, _SIMILARITIES, _SHEARS = slice(0, 2), slice(2, 4), slice(4, 6)

_TERMS = (_TRANSLATIONS, 3), (_SIMILARITIES, 1), (_SIMILARITIES, 3), (_SHEARS, 1)
"""Modes and orders of their differences, each with its own weight."""

_FIRST: Weights = (0.0,) * len(_TERMS)
"""Weights with which the search begins, relative to the mean information."""

_LIMITS = -16.0, 16.0
"""Smallest and largest logarithm of a weight, relative to the same."""

_MIN_INFORMATION = 1e-6
"""Added information, relative to the same, so that all systems are regular."""

_STEPS = 4.0, 2.0, 1.0, 0.5
"""Steps of the search for the logarithms of the weights."""

_MIN_GAIN = 1e-3
"""Smallest improvement in nats for which the search continues."""

_MIN_BLOCKS = 5
"""Fewer blocks are not smoothed."""


def smooth_affine(estimates: Array, information: Array) -> Array:
    """Return the most probable curve of affine motions, (n, 6).

    The errors of the estimates y are Gaussian with the information M, and the differences of the
    curve x are Gaussian with variances e⁻ʷ. So x minimizes (x - y)ᵀM(x - y) + Σ eʷ|Δx|². The
    weights w are those under which y is most probable.

    Parameters
    ----------
    estimates : ndarray of float, shape (n, 6)
        Estimated coefficients of :func:`jotlight.motion.tiles.affine_basis` in each block, first
        for rows and then for columns.
    information : ndarray of float, shape (n, 6, 6)
        Information about them.
    """
    if len(estimates) < _MIN_BLOCKS:
        return estimates.copy()
    # In these units, the mean information is 1.
    unit = max(float(np.trace(information, axis1=1, axis2=2).mean()) / 6, 1e-30) ** -0.5
    matrices = unit**2 * (_MODES @ information @ _MODES.T)
    problem = _Problem.of(estimates @ _MODES.T / unit, matrices)
    costs: dict[Weights, float] = {}

    def cost(weights: Weights) -> float:
        if weights not in costs:
            costs[weights] = problem.solve(weights)[0]
        return costs[weights]

    best = _FIRST
    for step in _STEPS:
        while True:
            nearby = min(_neighbors(best, step), key=cost)
            if cost(nearby) > cost(best) - _MIN_GAIN:
                break
            best = nearby
    return np.asarray(unit * problem.solve(best)[1] @ _MODES)


def _neighbors(weights: Weights, step: float) -> list[Weights]:
    """Return the weights of which one differs by a step."""
    return [
        (
            *weights[:index],
            float(np.clip(weights[index] + sign * step, *_LIMITS)),
            *weights[index + 1 :],
        )
        for index in range(len(weights))
        for sign in (1, -1)
    ]


@dataclasses.dataclass(frozen=True)
class _Problem:
    """The normal equations of a curve. Matrices are stored as their diagonals."""

    estimates: Array
    """y, (n, 6)."""
    information: Array
    """M: its diagonals from the main one downward, (19, 6 n)."""
    right: Array
    """M y, (n, 6)."""

    @classmethod
    def of(cls, estimates: Array, information: Array) -> Self:
        """Return the problem of estimates (n, 6) with their information (n, 6, 6)."""
        number = len(estimates)
        information = information + _MIN_INFORMATION * np.eye(6)
        right = np.einsum("nij,nj->ni", information, estimates)
        diagonals = np.zeros((6 * max(order for _, order in _TERMS) + 1, number, 6))
        for row in range(6):
            for column in range(row + 1):
                diagonals[row - column, :, column] = information[:, row, column]
        return cls(estimates, diagonals.reshape(len(diagonals), -1), right)

    def solve(self, weights: Weights) -> tuple[float, Array]:
        """Return -2 log p(y | w) without a constant, and the most probable curve x, (n, 6)."""
        from scipy.linalg import cho_solve_banded, cholesky_banded

        matrix = self.information.copy()
        blocks = matrix.reshape(len(matrix), *self.estimates.shape)
        squares = _squares(len(self.estimates))
        for weight, (modes, order), square in zip(weights, _TERMS, squares, strict=True):
            blocks[: 6 * order + 1 : 6, :, modes] += np.exp(weight) * square[:, :, None]
        root = cholesky_banded(matrix, lower=True, check_finite=False)
        solution = cho_solve_banded((root, True), self.right.ravel(), check_finite=False)
        curve = solution.reshape(self.estimates.shape)
        residual = float((self.right * (self.estimates - curve)).sum())
        return residual + 2 * float(np.log(root[0]).sum()) - self._log_prior(weights), curve

    def _log_prior(self, weights: Weights) -> float:
        """Return the logarithm of the determinant of Σ eʷ ΔᵀΔ, without those of null spaces."""
        number = len(self.estimates)
        translations, first, third, shears = weights
        similarities = np.log(np.exp(first) + np.exp(third) * _ratios(number)).sum()
        total = (number - 3) * translations + (number - 1) * shears + similarities
        return 2 * float(total)


@functools.lru_cache(maxsize=4)
def _squares(number: int) -> list[Array]:
    """Return ΔᵀΔ of each term: its diagonals from the main one downward, (order + 1, n)."""
    squares = []
    for _, order in _TERMS:
        full = _square_of_differences(number, order)
        diagonals = [np.append(np.diagonal(full, -k), np.zeros(k)) for k in range(order + 1)]
        squares.append(np.stack(diagonals))
    return squares


@functools.lru_cache(maxsize=4)
def _ratios(number: int) -> Array:
    """Return the squared third differences of the modes whose squared first differences are 1."""
    from scipy.linalg import eigh

    # Only constants have no differences. Without one value, the matrix of the first is regular.
    third, first = (_square_of_differences(number, order)[1:, 1:] for order in (3, 1))
    return np.asarray(np.maximum(eigh(third, first, eigvals_only=True), 0))


def _square_of_differences(number: int, order: int) -> Array:
    """Return ΔᵀΔ, (n, n), for differences of an order."""
    differences = np.diff(np.eye(number), order, axis=0)
    return np.asarray(differences.T @ differences)
