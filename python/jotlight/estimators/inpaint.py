"""Pixels of which nothing is known."""

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn

_TOLERANCE = 1e-6
"""Of the linear equations, relative."""

_MOST_STEPS = 200


def inpaint_dead_pixels(
    image: npt.NDArray[np.float32], blind: npt.NDArray[np.bool_] | None
) -> npt.NDArray[np.float32]:
    """Fill blind pixels so that each is the mean of its 8 neighbours (2 in a signal), and say so.

    Neighbours may be blind themselves, so that a hole is a system of linear equations, the
    discrete Laplace equation with the known pixels around for its boundary: a membrane spanned
    over the hole. A filled pixel is never below the least or above the largest known one.

    Raises
    ------
    ValueError
        When all pixels are blind.

    Notes
    -----
    Better than growing from the rim in holes of 3 x 3 pixels and more, where that leaves seams, and
    the same for single pixels. The biharmonic equation, whose slopes are smooth too, follows
    pictures without noise more closely still, but carries the noise of the rim into the hole.
    """
    if blind is None:
        return image
    if blind.all():
        raise ValueError("mask: expected at least one jot that is alive, got none")
    warn(
        f"{blind.sum()} of {blind.size} pixels have no valid jot and were filled from their "
        "neighbours"
    )
    known = image[~blind]
    filled = _grown(image, blind)
    filled[blind] = np.clip(_membrane(filled, blind), known.min(), known.max())
    return filled.astype(np.float32)


def _grown(image: npt.NDArray[np.float32], blind: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Fill from the rim of each hole inwards: where the equations' solution is looked for first."""
    from scipy.ndimage import correlate

    known = ~blind
    filled = np.where(known, image, 0).astype(np.float64)
    # No running sums as in uniform_filter: what they leave of the sums gone by may be below 0.
    window = np.ones((3,) * image.ndim)
    while not known.all():
        weight = correlate(known.astype(np.float64), window, mode="constant")
        total = correlate(np.where(known, filled, 0), window, mode="constant")
        rim = ~known & (weight > 0)
        filled[rim] = total[rim] / weight[rim]
        known |= rim
    return filled


def _membrane(
    filled: npt.NDArray[np.float64], blind: npt.NDArray[np.bool_]
) -> npt.NDArray[np.float64]:
    """The blind pixels that are the mean of their neighbours, by conjugate gradients."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import cg

    places = np.argwhere(blind)
    number = np.full(blind.shape, -1)
    number[blind] = np.arange(len(places))
    degree = np.zeros(len(places))
    around = np.zeros(len(places))
    rows, columns = [], []
    for offset in np.ndindex(*(3,) * blind.ndim):
        step = np.array(offset) - 1
        if not step.any():
            continue
        there = places + step
        inside = np.flatnonzero(((there >= 0) & (there < blind.shape)).all(axis=1))
        neighbour = tuple(there[inside].T)
        degree[inside] += 1
        also = blind[neighbour]
        around[inside[~also]] += filled[neighbour][~also]
        rows.append(inside[also])
        columns.append(number[neighbour][also])
    row, column = np.concatenate(rows), np.concatenate(columns)
    guess = filled[blind]
    if not len(row):
        return guess
    diagonal = np.arange(len(places))
    matrix = coo_array(
        (
            np.concatenate([-np.ones(len(row)), degree]),
            (np.concatenate([row, diagonal]), np.concatenate([column, diagonal])),
        )
    ).tocsr()
    # From the guess on, so that what is solved by it, such as single pixels, stays as it is.
    rest = around - matrix @ guess
    limit = _TOLERANCE * float(np.abs(around).max() or 1.0)
    scale = coo_array((1 / degree, (diagonal, diagonal))).tocsr()
    change, _ = cg(matrix, rest, rtol=0, atol=limit, maxiter=_MOST_STEPS, M=scale)
    return np.asarray(guess + change)
