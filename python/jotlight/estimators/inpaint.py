"""Inpainting of dead pixels, which have no valid bit, from their neighbors."""

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.sensing.bits.values import check_any_valid

_TOLERANCE = 1e-6
"""The tolerance of the linear equations, relative to their largest right-hand side."""

_MAX_CG_STEPS = 200
"""The maximum number of steps of conjugate gradients."""


NO_VALID_BIT = "have no valid bit"
"""What the warning about dead pixels contains."""

F = TypeVar("F", np.float32, np.float64)
"""The type of the pixels."""


def inpaint_dead_pixels(
    images: npt.NDArray[np.float32], dead: npt.NDArray[np.bool_] | None
) -> npt.NDArray[np.float32]:
    """Return the images with each dead pixel equal to the mean of its 8 neighbors (2 in a signal).

    Neighbors may be dead too. Each hole is then a system of linear equations: the discrete Laplace
    equation, with the known pixels around the hole as boundary. Filled pixels stay between the
    minimum and the maximum of the known pixels.

    Parameters
    ----------
    images : ndarray of float32, shape (H, W) or (N, H, W)
        An image, or a stack of them. The values of dead pixels are ignored.
    dead : ndarray of bool or None
        The mask of dead pixels, of the same shape. None means that no pixel is dead.

    Returns
    -------
    ndarray of float32
        The filled images; the input itself where no pixel is dead.

    Raises
    ------
    ValueError
        When all pixels of an image are dead.

    Warns
    -----
    JotlightWarning
        Once, when pixels were filled.

    Notes
    -----
    Filling from the border inward would leave seams in holes of 3 x 3 pixels and more; the Laplace
    equation leaves none. For single pixels both methods agree. The biharmonic equation, whose
    solution also has continuous slopes, is more accurate for images without noise. However, it
    extrapolates the noise of the border into the hole.

    Examples
    --------
    >>> import warnings
    >>> images = np.float32([[1.0, 0.0, 3.0]])
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore")
    ...     inpaint_dead_pixels(images, np.array([[False, True, False]])).tolist()
    [[1.0, 2.0, 3.0]]
    """
    if dead is None or not dead.any():
        return images
    if images.ndim == 2:
        return np.asarray(inpaint_dead_pixels(images[None], dead[None])[0])
    filled = fill_dead_pixels(images, dead)
    warn_about_dead_pixels(dead)
    return filled


def fill_dead_pixels(images: npt.NDArray[F], dead: npt.NDArray[np.bool_]) -> npt.NDArray[F]:
    """Return images whose dead pixels are filled, as :func:`inpaint_dead_pixels` does, silently.

    The images have the shape (N, H, W), and signals (N, length).

    Examples
    --------
    >>> fill_dead_pixels(np.array([[1.0, 0.0, 3.0]]), np.array([[False, True, False]])).tolist()
    [[1.0, 2.0, 3.0]]
    """
    if not dead.any():
        return images
    out = images.copy()
    for image, holes in zip(out, dead, strict=True):
        if not holes.any():
            continue
        check_any_valid(~holes)
        known = image[~holes]
        filled = _fill_inward(image, holes)
        image[holes] = np.clip(_solve_laplace(filled, holes), known.min(), known.max())
    return out


def warn_about_dead_pixels(dead: npt.NDArray[np.bool_]) -> None:
    """Warn once that the dead pixels of images were filled, if there are any.

    Parameters
    ----------
    dead : ndarray of bool, shape (N, H, W) or (N, length)
        The mask of dead pixels.
    """
    numbers = dead.reshape(len(dead), -1).sum(axis=1)
    if not numbers.any():
        return
    low, high = numbers[numbers > 0].min(), numbers.max()
    range_ = f"{high}" if low == high else f"{low} to {high}"
    images = "" if len(dead) == 1 else f"in {np.count_nonzero(numbers)} of {len(dead)} images, "
    warn(
        f"{images}{range_} of {dead[0].size} pixels {NO_VALID_BIT} and were inpainted from their "
        "neighbors"
    )


def _fill_inward(
    image: npt.NDArray[np.floating], dead: npt.NDArray[np.bool_]
) -> npt.NDArray[np.float64]:
    """Return the image with its holes filled from the border inward.

    It is the initial guess of the linear equations.
    """
    from scipy.ndimage import correlate

    known = ~dead
    filled = np.where(known, image, 0).astype(np.float64)
    # Not uniform_filter: rounding errors of its running sums can make a result negative.
    window = np.ones((3,) * image.ndim)
    while not known.all():
        weight = correlate(known.astype(np.float64), window, mode="constant")
        total = correlate(np.where(known, filled, 0), window, mode="constant")
        border = ~known & (weight > 0)
        filled[border] = total[border] / weight[border]
        known |= border
    return filled


def _solve_laplace(
    filled: npt.NDArray[np.float64], dead: npt.NDArray[np.bool_]
) -> npt.NDArray[np.float64]:
    """Return values of the dead pixels such that each equals the mean of its neighbors."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import cg

    positions = np.argwhere(dead)
    index = np.full(dead.shape, -1)
    index[dead] = np.arange(len(positions))
    degree = np.zeros(len(positions))
    known_sum = np.zeros(len(positions))
    rows, columns = [], []
    for offset in np.ndindex(*(3,) * dead.ndim):
        step = np.array(offset) - 1
        if not step.any():
            continue
        shifted = positions + step
        inside = np.flatnonzero(((shifted >= 0) & (shifted < dead.shape)).all(axis=1))
        neighbor = tuple(shifted[inside].T)
        degree[inside] += 1
        unknown = dead[neighbor]
        known_sum[inside[~unknown]] += filled[neighbor][~unknown]
        rows.append(inside[unknown])
        columns.append(index[neighbor][unknown])
    row, column = np.concatenate(rows), np.concatenate(columns)
    guess = filled[dead]
    if not len(row):
        return guess
    diagonal = np.arange(len(positions))
    matrix = coo_array(
        (
            np.concatenate([-np.ones(len(row)), degree]),
            (np.concatenate([row, diagonal]), np.concatenate([column, diagonal])),
        )
    ).tocsr()
    # The guess is exact for single pixels. Solving for its change keeps it exact there.
    residual = known_sum - matrix @ guess
    limit = _TOLERANCE * float(np.abs(known_sum).max() or 1.0)
    jacobi = coo_array((1 / degree, (diagonal, diagonal))).tocsr()
    change, _ = cg(matrix, residual, rtol=0, atol=limit, maxiter=_MAX_CG_STEPS, M=jacobi)
    return np.asarray(guess + change)
