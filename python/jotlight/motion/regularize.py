"""Fields of displacements from the normal equations of all tiles.

The displacement error e of a tile minimizes ½ eᵀA e - bᵀe, where A is the information about e, in
nats/px². Tiles with little texture have little information, so their neighbors must help.
"""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.motion.tiles import affine_basis

Array = npt.NDArray[np.float64]

_ROBUST_ROUNDS = 5
"""Number of rounds that reweight the tiles of an affine fit."""

_PRIOR = 1e-2
"""Information that is added to the coefficients of an affine fit."""

_MIN_SCALE = 9.0
"""Squared deviation, in variances, at which the weight of a tile is a quarter."""

_ROUNDING = 0.5
"""Information that is added to each tile before its own displacement is computed."""

_REWEIGHTINGS = (0.1, 1.0, 1.0)
"""Factors of λ2 in the rounds that reweight the differences of neighbors."""


@dataclasses.dataclass(frozen=True)
class Equations:
    """Normal equations of the displacement errors of all tiles.

    Parameters
    ----------
    information : ndarray of float, shape (3, rows, columns)
        A: the entries for rows, for rows and columns, and for columns.
    right : ndarray of float, shape (2, rows, columns)
        b: for rows and columns.
    """

    information: Array
    right: Array

    def times(self, vectors: Array) -> Array:
        """Return A times vectors of shape (2, rows, columns)."""
        rows, mixed, columns = self.information
        return np.stack(
            [rows * vectors[0] + mixed * vectors[1], mixed * vectors[0] + columns * vectors[1]]
        )


def fit_affine(equations: Equations, weights: Array) -> tuple[Array, Array]:
    """Return the affine displacement errors of a segment, and the information about them.

    Tiles that deviate, such as those of other objects, get small weights: (1 + q/c)⁻² with the
    squared deviation q in units of its variance, and c = max(9, 2 median q). The first weights are
    those of the deviations from 0, because the segment is known to move about as predicted.

    Parameters
    ----------
    equations : Equations
        Normal equations of all tiles.
    weights : ndarray of float, shape (rows, columns)
        Fraction of each tile that belongs to the segment.

    Returns
    -------
    errors : ndarray of float, shape (2, rows, columns)
        Displacement errors.
    information : ndarray of float, shape (6, 6)
        Information about the coefficients of :func:`jotlight.motion.tiles.affine_basis`, first for
        rows and then for columns.
    """
    shape = equations.right.shape[1:]
    basis = affine_basis((shape[0], shape[1]))
    information, right = equations.information.reshape(3, -1), equations.right.reshape(2, -1)
    own = _solve_each(information, right)
    belongs = weights.ravel()
    inside = belongs > 0
    errors = np.zeros_like(own)
    for _ in range(_ROBUST_ROUNDS):
        deviation = own - errors
        squared = (
            information[0] * deviation[0] ** 2
            + 2 * information[1] * deviation[0] * deviation[1]
            + information[2] * deviation[1] ** 2
        )
        scale = max(_MIN_SCALE, 2 * float(np.median(squared[inside]) if inside.any() else 0))
        trust = belongs * (1 + squared / scale) ** -2.0
        a, b, c = (basis.T @ (entry * trust * basis.T).T for entry in information)
        matrix = np.block([[a, b], [b, c]])
        coefficients = np.linalg.solve(matrix + _PRIOR * np.eye(6), (right * trust @ basis).ravel())
        errors = coefficients.reshape(2, 3) @ basis.T
    return errors.reshape(2, *shape), matrix


def _solve_each(information: Array, right: Array) -> Array:
    """Return the displacement error of each tile by itself, (2, tiles)."""
    rows, mixed, columns = information[0] + _ROUNDING, information[1], information[2] + _ROUNDING
    determinant = rows * columns - mixed**2
    return np.stack(
        [
            (columns * right[0] - mixed * right[1]) / determinant,
            (rows * right[1] - mixed * right[0]) / determinant,
        ]
    )


@dataclasses.dataclass(frozen=True)
class Smoothness:
    """How similar the displacements of neighboring tiles are.

    Parameters
    ----------
    to_prediction : float
        λ1: weight of the squared differences of neighbors' deviations from a prediction.
    to_affine : float
        λ2: weight of the squared differences of neighbors' deviations from an affine field.
    outline : float
        ρ: difference in pixels above which neighbors probably belong to different objects.
    """

    to_prediction: float = 5.0
    to_affine: float = 10.0
    outline: float = 0.5


def solve_field(
    equations: Equations, now: Array, predicted: Array, smoothness: Smoothness
) -> Array:
    """Return the smooth field of displacements u, (2, rows, columns), that fits the equations.

    It minimizes ½ dᵀA d - bᵀd + ½ λ1 Σ |∇(u - predicted)|² + ½ Σ w |∇(u - affine)|² with
    d = now - u. Here ∇ is the difference of neighboring tiles, `affine` is the robust affine fit to
    u, and w = λ2 / (1 + |∇(u - affine)|²/ρ²).
    """
    from scipy.sparse import bmat, diags, identity
    from scipy.sparse.linalg import spsolve

    shape = (now.shape[1], now.shape[2])
    tiles = shape[0] * shape[1]
    basis, neighbors = affine_basis(shape), _neighbors(shape)
    information = equations.information.reshape(3, tiles)
    trust = information[0] + information[2] + 1e-3
    flat_now, flat_predicted = now.reshape(2, tiles), predicted.reshape(2, tiles)
    to_prediction = _laplacian(neighbors, np.full(len(neighbors[0]), smoothness.to_prediction))
    data = (equations.times(now) - equations.right).reshape(2, tiles)
    field = flat_now
    for factor in _REWEIGHTINGS:
        affine = _robust_affine(basis, field, trust)
        deviation = field - affine
        squared = ((deviation[:, neighbors[0]] - deviation[:, neighbors[1]]) ** 2).sum(axis=0)
        weights = factor * smoothness.to_affine / (1 + squared / smoothness.outline**2)
        to_affine = _laplacian(neighbors, weights)
        both = to_prediction + to_affine
        rows, mixed, columns = (diags(entry) for entry in information)
        matrix = bmat([[rows + both, mixed], [mixed, columns + both]]) + 1e-4 * identity(2 * tiles)
        right = (
            data
            + (to_prediction @ flat_predicted.T).T
            + (to_affine @ affine.T).T
            + 1e-4 * flat_predicted
        )
        field = spsolve(matrix.tocsc(), right.ravel()).reshape(2, tiles)
    return np.asarray(field.reshape(now.shape))


def _neighbors(shape: tuple[int, int]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the indices of all pairs of neighboring tiles."""
    index = np.arange(shape[0] * shape[1]).reshape(shape)
    first = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    second = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    return first, second


def _laplacian(neighbors: tuple[npt.NDArray[np.intp], ...], weights: Array) -> Any:
    """Return the matrix L with ½ uᵀL u = ½ Σ w (u_i - u_j)² over the pairs of neighbors."""
    from scipy.sparse import coo_array

    first, second = neighbors
    size = int(max(first.max(initial=0), second.max(initial=0))) + 1
    values = np.concatenate([weights, weights, -weights, -weights])
    rows = np.concatenate([first, second, first, second])
    columns = np.concatenate([first, second, second, first])
    return coo_array((values, (rows, columns)), shape=(size, size)).tocsr()


def _robust_affine(basis: Array, field: Array, trust: Array) -> Array:
    """Return the affine field, (2, tiles), that is closest to most tiles of a field."""
    weights = trust
    for _ in range(_ROBUST_ROUNDS):
        roots = np.sqrt(weights)[:, None]
        parameters = np.linalg.lstsq(basis * roots, field.T * roots, rcond=None)[0]
        affine = (basis @ parameters).T
        squared = ((field - affine) ** 2).sum(axis=0)
        weights = trust / (1 + squared / max(0.25, float(np.median(squared)))) ** 2
    return affine
