"""Whole numbers of ones and zeros instead of real ones, with about the same sums."""

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.sensing.response import Array


def diffuse(values: Array, is_known: npt.NDArray[np.bool_], threads: int | None = None) -> Array:
    """Return whole numbers from 0 instead of real ones, with about the same sum along each row.

    The error of a pixel is added to the next pixel of its row. So the mean of a region stays right
    even if all its values are alike, which are all rounded in the same direction otherwise. Rows
    begin with different errors, so that they make no pattern together. If the numbers are negative,
    their deficit is subtracted from the next pixels, up to a total of 1.

    Parameters
    ----------
    values : ndarray of float64, shape (H, W)
        The numbers.
    is_known : ndarray of bool, shape (H, W)
        Where the result may be above 0.
    threads : int, optional
        The number of threads. Default: all.

    Examples
    --------
    >>> diffuse(np.full((2, 8), 0.25), np.ones((2, 8), bool)).astype(int)
    array([[0, 0, 0, 1, 0, 0, 0, 1],
           [0, 1, 0, 0, 0, 1, 0, 0]])
    """
    whole = np.empty(values.shape)
    engine.diffuse(values, is_known, whole, threads)
    return whole


def carry_debts(values: Array) -> Array:
    """Return numbers from 0 with the same sums along each row, as far as debts can be paid.

    Examples
    --------
    >>> carry_debts(np.array([[1.0, -0.75, 0.5, 0.5]]))
    array([[1.  , 0.  , 0.  , 0.25]])
    """
    sums = np.cumsum(values, axis=-1)
    paid = np.maximum(np.maximum.accumulate(sums, axis=-1), 0)
    return np.diff(paid, axis=-1, prepend=0.0)
