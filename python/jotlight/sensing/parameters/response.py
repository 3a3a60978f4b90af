"""The response of a jot to its rate, P(q, s): its value, derivative, and inverse.

The functions work in double precision. The inverse takes both p and 1 - p, so that probabilities
near 1 keep their digits. The engine solves the same equations for whole images.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.interrupts import interruptible
from jotlight.underflow import underflows_to_0

A = TypeVar("A", bound=Any)


class JotResponse(NamedTuple):
    """How a jot turns photons into a reading, as the engine expects it."""

    max_reading: int
    """2^b - 1."""
    read_noise: float
    """σ, in photons."""
    threshold: int
    """q, for readings of one bit."""


class PixelResponse(NamedTuple):
    """The response of a pixel with the box kernel, as the engine expects it."""

    threshold: int
    """q."""
    light_per_intensity: float
    """α/K, in expected photons per jot and frame."""
    max_intensity: float
    """S."""


def probability_formula(
    threshold: int, rate: A, expm1: Callable[[A], A], gammainc: Callable[[int, A], A]
) -> A:
    """Return P(q, s), computed with the functions of any array library: equation (3).

    `gammainc(q, s)` is the regularized lower incomplete gamma function. For q = 1 it equals
    1 - exp(-s), which is about twenty times as fast.
    """
    probability: A = -expm1(-rate) if threshold == 1 else gammainc(threshold, rate)
    return probability


def detection_probability(threshold: int, rate: npt.ArrayLike) -> Array:
    """Return P(q, s), the probability that a jot at rate s reports 1: equation (3).

    Parameters
    ----------
    threshold : int
        q: the minimum number of photons for which a jot reports 1.
    rate : array_like of float
        s: the expected detections per frame, 0 or more.

    Examples
    --------
    >>> detection_probability(1, [0.0, 1.0]).round(4).tolist()
    [0.0, 0.6321]
    """
    return np.asarray(
        probability_formula(threshold, np.asarray(rate, np.float64), np.expm1, _gammainc)
    )


@underflows_to_0
def silence_probability(threshold: int, rate: npt.ArrayLike) -> Array:
    """Return 1 - P(q, s), the probability that a jot at rate s reports 0, with all digits.

    Examples
    --------
    >>> float(silence_probability(1, 50.0))
    1.9287498479639178e-22
    """
    s = np.asarray(rate, np.float64)
    if threshold == 1:
        return np.asarray(np.exp(-s))
    from scipy.special import gammaincc

    return np.asarray(interruptible(gammaincc)(threshold, s))


@underflows_to_0
def detection_density(threshold: int, rate: npt.ArrayLike) -> Array:
    """Return ∂P/∂s = s^(q - 1) exp(-s) / (q - 1)!.

    Examples
    --------
    >>> detection_density(2, 1.0).round(4).tolist()
    0.3679
    """
    s = np.asarray(rate, np.float64)
    if threshold == 1:
        return np.asarray(np.exp(-s))
    from scipy.special import gammaln, xlogy

    return np.asarray(np.exp(xlogy(threshold - 1, s) - s - gammaln(threshold)))


def inverse_detection_probability(
    threshold: int, probability: npt.ArrayLike, complement: npt.ArrayLike
) -> Array:
    """Return P⁻¹(q, p), the rate at which a jot reports 1 with probability p.

    Parameters
    ----------
    threshold : int
        q: the minimum number of photons for which a jot reports 1.
    probability, complement : array_like of float
        p and 1 - p in [0, 1]. The result is computed from the smaller one; for 1 - p = 0 it is
        infinite.

    Examples
    --------
    >>> inverse_detection_probability(1, [0.5, 1.0], [0.5, 1e-20]).round(4).tolist()
    [0.6931, 46.0517]
    """
    p, rest = np.asarray(probability, np.float64), np.asarray(complement, np.float64)
    if threshold == 1:
        # This closed form avoids the import of SciPy, which takes long.
        with np.errstate(divide="ignore"):
            small, large = -np.log1p(-np.minimum(p, 0.5)), -np.log(np.minimum(rest, 0.5))
        return np.asarray(np.where(p < rest, small, large))
    from scipy.special import gammainccinv, gammaincinv

    return np.asarray(
        np.where(
            p < rest,
            interruptible(gammaincinv)(threshold, np.minimum(p, 0.5)),
            interruptible(gammainccinv)(threshold, np.minimum(rest, 0.5)),
        )
    )


def intensity_at_probability(
    threshold: int,
    probability: npt.ArrayLike,
    complement: npt.ArrayLike,
    slope: float | Array,
    dark_counts: float | Array,
) -> Array:
    """Return the intensity at which jots report 1 with probability p: equation (5), p for L/K.

    It is ``c = (P⁻¹(q, p) - d)/(η α/K)``, which is below 0 if p is smaller than in darkness.

    Parameters
    ----------
    threshold : int
        q: the minimum number of photons for which a jot reports 1.
    probability, complement : array_like of float
        p and 1 - p in [0, 1].
    slope : float or ndarray
        η α/K, the rate of a jot per intensity. With η, the result is the light s = c α/K.
    dark_counts : float or ndarray
        d.

    Examples
    --------
    >>> intensity_at_probability(1, [0.5, 0.0], [0.5, 1.0], 2.0, 0.1).round(4).tolist()
    [0.2966, -0.05]
    """
    rate = inverse_detection_probability(threshold, probability, complement)
    return np.asarray((rate - dark_counts) / slope)


def _gammainc(order: int, x: Array) -> Array:
    # The import of SciPy takes long, so it is postponed until it is needed.
    from scipy.special import gammainc

    return np.asarray(interruptible(gammainc)(order, x))
