"""Binomial fractions: limits of their probability, and a transform after which noise is uniform.

The fraction of ones among K bits has the variance p (1 - p)/K. The angle z = arcsin √p of a
fraction has nearly the variance 1/(4 K), whatever p is.
"""

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.interrupts import interruptible

Real = TypeVar("Real", bound=np.floating)


def arcsin_root(fraction: npt.NDArray[Real]) -> npt.NDArray[Real]:
    """Return z = arcsin √p, of the type of p. Fractions are clipped to [0, 1].

    Examples
    --------
    >>> arcsin_root(np.array([0.0, 0.5, 1.0])).round(3).tolist()
    [0.0, 0.785, 1.571]
    """
    return np.asarray(np.arcsin(np.sqrt(np.clip(fraction, 0, 1))))


def squared_sine(z: npt.NDArray[Real]) -> npt.NDArray[Real]:
    """Return p = sin² z, the inverse of :func:`arcsin_root`, of the type of z.

    Examples
    --------
    >>> squared_sine(arcsin_root(np.array([0.0, 0.25, 1.0]))).round(3).tolist()
    [0.0, 0.25, 1.0]
    """
    return np.asarray(np.sin(z) ** 2)


def upper_tail(ones: npt.NDArray[Any], zeros: npt.NDArray[Any], p: Array) -> Array:
    """Return the probability of these numbers of ones or more, if bits are 1 with probability p.

    Parameters
    ----------
    ones, zeros : ndarray of real numbers, any shape
        Numbers of ones and of zeros.
    p : ndarray of float64, the same shape
        The probability of a one.

    Examples
    --------
    >>> upper_tail(np.array([0, 1, 2]), np.array([2, 1, 0]), np.full(3, 0.5)).round(4)
    array([1.  , 0.75, 0.25])
    """
    from scipy.special import betainc

    tail = interruptible(betainc)(np.maximum(ones, 1), np.maximum(zeros, 0) + 1, p)
    return np.asarray(np.where(ones > 0, tail, 1.0))


def upper_limit(
    ones: npt.NDArray[Any], zeros: npt.NDArray[Any], tail: float
) -> tuple[Array, Array]:
    """Return the upper limit of Clopper and Pearson for p, and its complement 1 - p.

    Parameters
    ----------
    ones, zeros : ndarray of real numbers, any shape
        Numbers of ones and of zeros. The limit is 1 without zeros.
    tail : float
        The largest probability that p is above the limit.

    Examples
    --------
    >>> limit, complement = upper_limit(np.array([0]), np.array([10]), 0.05)
    >>> limit.round(4), complement.round(4)  # 0.05 ** (1 / 10) = 0.7411
    (array([0.2589]), array([0.7411]))
    """
    from scipy.special import betainccinv, betaincinv

    inverse, complement = interruptible(betaincinv), interruptible(betainccinv)
    with np.errstate(all="ignore"):
        above = np.where(zeros > 0, inverse(np.where(zeros > 0, zeros, 1), ones + 1, tail), 0.0)
        limit = np.where(zeros > 0, complement(ones + 1, np.where(zeros > 0, zeros, 1), tail), 1.0)
    return limit, above


def clopper_pearson(
    ones: npt.NDArray[Any], bits: npt.NDArray[Any], tail: float, *, jots_differ: bool
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the ends of the interval for p, each with its complement 1 - p.

    Parameters
    ----------
    ones, bits : ndarray, any shape
        Numbers of ones and of bits.
    tail : float
        The largest probability that p is beyond an end.
    jots_differ : bool
        Whether p is the mean of the different probabilities of the bits.

    Examples
    --------
    >>> ones, bits = np.array([1]), np.array([2])
    >>> (low, _), (high, _) = clopper_pearson(ones, bits, 0.025, jots_differ=False)
    >>> low.round(4), high.round(4)
    (array([0.0126]), array([0.9874]))
    """
    zeros = bits - ones
    above_low, low = upper_limit(zeros, ones, tail)
    high, above_high = upper_limit(ones, zeros, tail)
    if jots_differ:
        # For a single 1 (or 0) among unequal bits the binomial tail does not bound the true tail.
        # The sum of the probabilities does.
        share = tail / np.maximum(bits, 1)
        one, zero = ones == 1, zeros == 1
        low, above_low = np.where(one, share, low), np.where(one, 1 - share, above_low)
        above_high, high = np.where(zero, share, above_high), np.where(zero, 1 - share, high)
    return (low, above_low), (high, above_high)
