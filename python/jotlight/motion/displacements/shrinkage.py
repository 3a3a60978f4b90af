"""Affine motions in dim light: rotation, zoom, and shear only as far as the bits show them.

The six coefficients of an affine motion are two of a translation and four linear ones. In dim
light, the linear ones may be only noise, which displaces the corners of the image by pixels. They
are multiplied by a factor that tends to 0 in this case, and to 1 if they are clearly visible.
"""

import numpy as np

from jotlight.array_types import Array
from jotlight.motion.tiles import affine_basis, affine_inverse

_SINGULAR = 1e-12
"""Determinant, relative to the squared trace, up to which a matrix is singular."""

TRANSLATION, LINEAR = [0, 3], [1, 2, 4, 5]
"""Indices of the coefficients of the translation, and of the linear ones."""

_ORDERED = np.ravel_multi_index(np.ix_(TRANSLATION + LINEAR, TRANSLATION + LINEAR), (6, 6)).ravel()
"""Indices of the entries of a matrix (6, 6) that begins with those of the translation."""


def information_of_linear(information: Array) -> tuple[Array, Array]:
    """Return the information about the linear coefficients, and their effect on the translation.

    Parameters
    ----------
    information : ndarray of float, shape (6, 6)
        Information about all coefficients.

    Returns
    -------
    marginal : ndarray of float, shape (4, 4)
        Information about the linear coefficients if the translation is unknown.
    effect : ndarray of float, shape (2, 4)
        By how much the estimated translation decreases if the linear coefficients increase.
    """
    ordered = information.take(_ORDERED).reshape(6, 6)
    mixed = ordered[:2, 2:]
    effect = _inverse(ordered[:2, :2]) @ mixed
    return ordered[2:, 2:] - mixed.T @ effect, effect


def _inverse(matrix: Array) -> Array:
    """Return the inverse of a symmetric matrix (2, 2), or the pseudoinverse of a singular one."""
    (a, b), (_, c) = matrix.tolist()
    determinant = a * c - b * b
    if determinant <= _SINGULAR * (a + c) ** 2:
        return np.asarray(np.linalg.pinv(matrix))
    return np.asarray(np.array([[c, -b], [-b, a]]) / determinant)


def shrinkage_factor(chi_squared: float, freedom: float) -> float:
    """Return the factor of James and Stein (1961): 0 for noise, and near 1 for clear values.

    Examples
    --------
    >>> [shrinkage_factor(chi_squared, 4) for chi_squared in (3.0, 8.0, 400.0)]
    [0.0, 0.5, 0.99]
    """
    return max(0.0, 1 - freedom / max(chi_squared, 1e-30))


def shrink_field(field: Array, information: Array) -> Array:
    """Return an affine field (2, rows, columns) whose linear part is shrunk.

    Parameters
    ----------
    field : ndarray of float, shape (2, rows, columns)
        An estimate.
    information : ndarray of float, shape (6, 6)
        Information about its coefficients, as
        :func:`jotlight.motion.displacements.regularize.fit_affine` returns it.
    """
    shape = field.shape[1], field.shape[2]
    coefficients = (field.reshape(2, -1) @ affine_inverse(shape).T).ravel()
    linear = coefficients[LINEAR]
    marginal, effect = information_of_linear(information)
    shrunk = shrinkage_factor(float(linear @ marginal @ linear), len(LINEAR)) * linear
    coefficients[TRANSLATION] += effect @ (linear - shrunk)
    coefficients[LINEAR] = shrunk
    return np.asarray((coefficients.reshape(2, 3) @ affine_basis(shape).T).reshape(field.shape))


def translation_of(field: Array, information: Array) -> Array:
    """Return the translation (2, rows, columns) that fits best if nothing else moves.

    The parameters are those of :func:`shrink_field`.
    """
    inverse = affine_inverse((field.shape[1], field.shape[2]))
    coefficients = (field.reshape(2, -1) @ inverse.T).ravel()
    _, effect = information_of_linear(information)
    translation = coefficients[TRANSLATION] + effect @ coefficients[LINEAR]
    return np.broadcast_to(translation[:, None, None], field.shape).copy()
