"""The uncertainty of maximum likelihood for readings with different gains and thresholds."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.estimators.joint_mle import maximize, regular_maximum, solve_expected_ones
from jotlight.estimators.uncertainty import Uncertainty, clopper_pearson
from jotlight.sensing.joint_likelihood import JointLikelihood, Term, joint_likelihood
from jotlight.sensing.pixel_counts import GrayImages
from jotlight.sensing.response import Array, detection_probability, silence_probability
from jotlight.sensing.sensor import Sensor

_MAX_EXACT_TRIALS = 256
"""Maximum number of readings of a pixel for which the distribution of the ones is computed."""

_STEPS = 48
"""Number of bisections of an end of an interval."""

_MIN_RATIO = 1e-3
"""Smallest ratio of the bounds between which a bisection takes place."""


def joint_uncertainty(
    images: GrayImages, sensor: Sensor, confidence_level: float, threads: int | None
) -> Uncertainty:
    """Return the standard error and the interval of `jotlight.mle`, in units of intensity.

    Parameters
    ----------
    images : GrayImages
        The data.
    sensor : Sensor
        Their sensor, whose readings may differ.
    confidence_level : float
        The coverage of the intervals, in [0.5, 1).
    threads : int, optional
        The number of threads. Default: all cores.

    Notes
    -----
    The standard error is I^(-1/2), where I is the information of the readings about the intensity,
    at :func:`jotlight.estimators.joint_mle.regular_maximum`.

    The interval is that of the total number of ones L, whose distribution rises with the intensity.
    The probability of L ones or more at the lower end is (1 - `confidence_level`)/2, and so is that
    of L ones or fewer at the upper end. For up to 256 equal readings in all pixels, the
    distribution is the exact one, a convolution of binomial distributions. Otherwise it is bounded
    by the binomial distribution with the same mean (Hoeffding 1956), so that the interval is wider
    than necessary. The coverage is at least `confidence_level` in both cases. Intervals are
    extended to include the estimate.
    """
    each = [
        _uncertainty(joint_likelihood(one, sensor, threads), confidence_level)
        for one in images.data
    ]
    return Uncertainty.arrange(each, images.layout)


def _uncertainty(joint: JointLikelihood, confidence_level: float) -> Uncertainty:
    """Return the uncertainty of a gray image, whose arrays have the shape (1, H, W)."""
    ones, trials = joint.ones, joint.trials
    dead = trials == 0
    saturated = (ones == trials) & ~dead
    low, high = _interval(joint, ones, trials, (1 - confidence_level) / 2)
    estimate = maximize(joint)
    low, high = np.minimum(low, estimate), np.maximum(high, estimate)
    low[dead], high[dead | saturated] = 0, joint.sensor.max_intensity
    with np.errstate(divide="ignore", over="ignore"):
        error = 1 / np.sqrt(joint.information(regular_maximum(joint)))
        standard_error = error.astype(np.float32)
    return Uncertainty(
        standard_error=standard_error[None],
        low=low.astype(np.float32)[None],
        high=high.astype(np.float32)[None],
        unlit=((low <= 0) & ~dead)[None],
        saturated=saturated[None],
        dead=dead[None],
        unlikely=np.zeros_like(dead)[None],
        confidence_level=confidence_level,
    )


def _interval(
    joint: JointLikelihood, ones: Array, trials: Array, tail: float
) -> tuple[Array, Array]:
    """Return the ends of the interval of each pixel."""
    if joint.uniform and trials.flat[0] <= _MAX_EXACT_TRIALS:
        distinct, places = np.unique(ones, return_inverse=True)
        first, last = _exact_ends(joint, distinct.astype(np.int64), tail)
        return first[places].reshape(ones.shape), last[places].reshape(ones.shape)
    probabilities = clopper_pearson(ones, trials, tail, jots_differ=True)
    low, high = (solve_expected_ones(joint, trials * p) for p, _ in probabilities)
    return low, high


def _exact_ends(
    joint: JointLikelihood, ones: npt.NDArray[np.int64], tail: float
) -> tuple[Array, Array]:
    """Return the ends of the intervals of some total numbers of ones in a uniform image."""
    places, highest = np.arange(len(ones)), joint.sensor.max_intensity

    def bisect(is_below: Callable[[Array], npt.NDArray[np.bool_]]) -> tuple[Array, Array]:
        """Return the bounds of the highest intensity at which a condition holds."""
        low, high = np.zeros(len(ones)), np.full(len(ones), highest)
        for _ in range(_STEPS):
            middle = np.sqrt(np.maximum(low, _MIN_RATIO * high) * high)
            below = is_below(distribution_of_ones(joint.terms, middle).cumsum(axis=1))
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return low, high

    # At the lower end, the probability of these ones or more is `tail`; at the upper end, that of
    # these or fewer.
    fewer = np.maximum(ones - 1, 0)
    low, _ = bisect(lambda cumulative: 1 - cumulative[places, fewer] < tail)
    _, high = bisect(lambda cumulative: cumulative[places, ones] > tail)
    return np.where(ones > 0, low, 0.0), np.where(ones < joint.trials.flat[0], high, highest)


def distribution_of_ones(terms: tuple[Term, ...], intensity: Array) -> Array:
    """Return the probabilities of 0 to N ones of a pixel at each intensity, (len, N + 1).

    It is the convolution of the binomial distributions of the groups.

    Examples
    --------
    >>> from jotlight.sensing.bits import Bits
    >>> joint = joint_likelihood(
    ...     Bits.from_array([[[1]], [[0]]]), Sensor(frames=2, gain=[np.log(2), np.log(4)]), None
    ... )
    >>> distribution_of_ones(joint.terms, np.array([1.0])).round(4)  # p = 1/2 and 3/4
    array([[0.125, 0.5  , 0.375]])
    """
    from scipy.special import gammaln, xlogy

    length = 1 + sum(int(float(np.max(term.cells.trials))) for term in terms)
    product = np.ones((len(intensity), length // 2 + 1), np.complex128)
    for term in terms:
        cells, number = term.cells, int(float(np.max(term.cells.trials)))
        rate = cells.efficiency * term.light * intensity[:, None] + cells.dark_counts
        one = detection_probability(cells.threshold, rate)
        zero = silence_probability(cells.threshold, rate)
        counts = np.arange(number + 1.0)
        logarithms = xlogy(counts, one) + xlogy(number - counts, zero) + gammaln(number + 1)
        logarithms -= gammaln(counts + 1) + gammaln(number - counts + 1)
        product *= np.fft.rfft(np.exp(logarithms), length, axis=1)
    return np.asarray(np.clip(np.fft.irfft(product, length, axis=1), 0, 1))
