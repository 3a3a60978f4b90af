"""Fields of displacements from the normal equations of all tiles.

The displacement error e of a tile minimizes ½ eᵀA e - bᵀe, where A is the information about e, in
nats/px². Tiles with little texture have little information, so their neighbors must help.
"""

import dataclasses

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.motion.tiles import affine_basis


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

    Raises
    ------
    ValueError
        When the shapes do not match, or a value is not finite.
    """
    basis = affine_basis((equations.right.shape[1], equations.right.shape[2]))
    return engine.fit_affine(equations.information, equations.right, weights, basis)


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

    Parameters
    ----------
    equations : Equations
        Normal equations of the displacement errors d of all tiles.
    now, predicted : ndarray of float, shape (2, rows, columns)
        Displacements at which the equations were computed, and those that are expected.
    smoothness : Smoothness
        Weights of the differences of neighboring tiles.

    Raises
    ------
    ValueError
        When the shapes do not match, or a value is outside its range.
    """
    basis = affine_basis((equations.right.shape[1], equations.right.shape[2]))
    return engine.solve_field(
        equations.information,
        equations.right,
        now,
        predicted,
        basis,
        dataclasses.astuple(smoothness),
    )
