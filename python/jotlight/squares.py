"""Sums over squares of pixels."""

import functools
from typing import Any, Literal

import numpy as np
import numpy.typing as npt


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
