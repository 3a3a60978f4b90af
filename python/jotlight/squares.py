"""Sums and means over squares of pixels, and values that all pixels of a square have."""

import functools
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

Scalar = TypeVar("Scalar", bound=np.generic)


def sum_squares(
    values: npt.NDArray[Any], side: int = 2, *, beyond: Literal["edge", "empty"] = "edge"
) -> npt.NDArray[Any]:
    """Return the sums over squares of pixels, (..., ⌈H / side⌉, ⌈W / side⌉).

    Sums of whole numbers and of bool are int64, and other sums have the type of the values.

    Parameters
    ----------
    values : ndarray, shape (..., H, W)
        The values of the pixels.
    side : int
        The side of a square in pixels, 2 or more.
    beyond : {"edge", "empty"}
        What fills the squares beyond the last row and column: the pixels of the edge once more, or
        nothing.

    Examples
    --------
    >>> values = np.array([[1, 2, 3], [4, 5, 6]])
    >>> sum_squares(values), sum_squares(values, beyond="empty")
    (array([[12, 18]]), array([[12,  9]]))
    """
    height, width = values.shape[-2:]
    if height % side or width % side:
        margins = [(0, 0)] * (values.ndim - 2) + [(0, -height % side), (0, -width % side)]
        values = np.pad(values, margins, mode="edge" if beyond == "edge" else "constant")
    # As np.sum, but without copies. Sums of whole numbers may exceed their type.
    add = functools.partial(np.add, dtype=np.int64 if values.dtype.kind in "biu" else None)
    rows = functools.reduce(add, [values[..., row::side, :] for row in range(side)])
    return np.asarray(functools.reduce(add, [rows[..., column::side] for column in range(side)]))


def mean_squares(
    values: npt.NDArray[np.floating], side: int, dtype: npt.DTypeLike | None = None
) -> npt.NDArray[Any]:
    """Return the means over whole squares of pixels, (..., ⌊H / side⌋, ⌊W / side⌋).

    Parameters
    ----------
    values : ndarray of float, shape (..., H, W)
        The values of the pixels. Those that fill no whole square are left out.
    side : int
        The side of a square in pixels.
    dtype : dtype, optional
        The type of the means. Default: that of the values.

    Examples
    --------
    >>> mean_squares(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), 2)
    array([[3.]])
    """
    height, width = (length // side for length in values.shape[-2:])
    whole = values[..., : height * side, : width * side]
    squares = whole.reshape(*values.shape[:-2], height, side, width, side)
    return np.asarray(squares.mean(axis=(-3, -1), dtype=dtype))


def repeat_squares(
    values: npt.NDArray[Scalar], side: int, size: tuple[int, int] | None = None
) -> npt.NDArray[Scalar]:
    """Return values at all pixels of their squares, (..., side H, side W), or of a smaller size.

    Parameters
    ----------
    values : ndarray, shape (..., H, W)
        The value of each square.
    side : int
        The side of a square in pixels.
    size : (int, int), optional
        Rows and columns of the result. The last squares may exceed it. Default: whole squares.

    Examples
    --------
    >>> repeat_squares(np.array([[1, 2]]), 2, (2, 3)).tolist()
    [[1, 1, 2], [1, 1, 2]]
    """
    pixels = values.repeat(side, axis=-2).repeat(side, axis=-1)
    return pixels if size is None else pixels[..., : size[0], : size[1]]
