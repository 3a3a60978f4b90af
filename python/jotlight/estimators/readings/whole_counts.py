"""Whole numbers of ones and zeros instead of real ones, with about the same sums."""

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.estimators.readings.neighbors import each_filter
from jotlight.sensing.merged import MAX_SILENT_TRIALS
from jotlight.sensing.parameters.response import detection_probability

_NO_ZERO = 0.01
"""Real number of zeros below which a pixel counts as saturated."""


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
        The number of threads. Default: the number of cores.

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


def complete_trials(
    ones: Array,
    trials: Array,
    rate: Array,
    is_known: npt.NDArray[np.bool_] | None = None,
    threshold: int = 1,
) -> tuple[Array, Array]:
    """Return ones and trials, where pixels of less than one trial are completed to one.

    Denoisers take each pixel for at least one trial, and 0 ones of fewer trials for darkness. What
    is missing agrees with the rate of a trial.

    Parameters
    ----------
    ones, trials : ndarray of float64, shape (H, W)
        The numbers.
    rate : ndarray of float64, shape (H, W)
        The expected detections of a trial.
    is_known : ndarray of bool, shape (H, W), optional
        The pixels with data. Default: all.
    threshold : int
        The threshold of the trials.

    Examples
    --------
    >>> ones, trials = complete_trials(np.zeros(2), np.array([0.5, 3.0]), np.full(2, np.log(2)))
    >>> ones.round(9).tolist(), trials.tolist()
    ([0.25, 0.0], [1.0, 3.0])
    """
    missing = np.maximum(1 - trials, 0)
    if is_known is not None:
        missing = np.where(is_known, missing, 0.0)
    return ones + missing * detection_probability(threshold, rate), trials + missing


def whole_counts(
    ones: Array,
    trials: Array,
    pattern: npt.NDArray[np.integer] | None = None,
    threads: int | None = None,
) -> tuple[npt.NDArray[np.int32], Array]:
    """Return whole ones, whose errors cancel among pixels with the same filter, and their trials.

    Where there are more ones than trials, the next pixels have fewer trials. Pixels whose trials
    are all ones stay without a zero.

    Parameters
    ----------
    ones, trials : ndarray of float64, shape (H, W)
        The numbers.
    pattern : ndarray of int, shape (H, W), optional
        The filter of each pixel. Default: all have the same one.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> ones, trials = whole_counts(np.full((1, 8), 0.25), np.ones((1, 8)))
    >>> ones.tolist(), float(trials.sum())
    ([[0, 0, 0, 1, 0, 0, 0, 1]], 8.0)
    """
    whole, zeros = np.zeros(ones.shape), np.zeros(ones.shape)
    for own in each_filter(pattern, ones.shape):
        whole += diffuse(np.where(own, ones, 0.0), own & (trials > 0), threads)
        # A fraction of a zero, by which rounding changes the ones, would darken saturated pixels.
        real = trials - ones
        own_zeros = np.where(real < _NO_ZERO, np.minimum(real, 0.0), trials - whole)
        zeros += carry_debts(np.where(own, own_zeros, 0.0))
    trials = np.where(whole + zeros > 0, whole + zeros, np.minimum(trials, MAX_SILENT_TRIALS))
    return whole.astype(np.int32), trials
