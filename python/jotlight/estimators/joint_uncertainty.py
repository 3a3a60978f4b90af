"""The uncertainty of maximum likelihood for readings with different gains and thresholds."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.estimators.joint_mle import maximize, regular_maximum, solve_expected_total
from jotlight.estimators.uncertainty import Uncertainty, clopper_pearson
from jotlight.sensing.joint_likelihood import JointLikelihood, joint_likelihood
from jotlight.sensing.joint_term import Term
from jotlight.sensing.multibit import ReadingLikelihood
from jotlight.sensing.pixel_counts import GrayImages
from jotlight.sensing.response import Array, detection_probability, silence_probability
from jotlight.sensing.sensor import Sensor

_MAX_EXACT_TOTAL = {True: 256, False: 1024}
"""Maximum total of the readings of a pixel, of one bit and of several, whose distribution is
computed."""

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

    The interval is that of the total of the readings L, whose distribution rises with the
    intensity; for bits, it is the number of ones. The probability of L or more at the lower end is
    (1 - `confidence_level`)/2, and so is that of L or less at the upper end. If all pixels are
    alike, and L is at most 256 for bits and 1024 for readings of several bits, the distribution is
    the exact one, a convolution of those of the readings. Otherwise that of bits is bounded by the
    binomial distribution with the same mean (Hoeffding 1956), so that the interval is wider than
    necessary. The coverage is at least `confidence_level` in both cases. Longer totals of several
    bits are taken as normal, with their exact mean and variance (Wilson 1927) and half a photon
    on each side. Intervals are extended to include the estimate.
    """
    each = [
        _uncertainty(joint_likelihood(one, sensor, threads), confidence_level)
        for one in images.data
    ]
    return Uncertainty.arrange(each, images.layout)


def _uncertainty(joint: JointLikelihood, confidence_level: float) -> Uncertainty:
    """Return the uncertainty of a gray image, whose arrays have the shape (1, H, W)."""
    dead = joint.trials == 0
    saturated = (joint.total == joint.max_total) & ~dead
    low, high = _interval(joint, (1 - confidence_level) / 2)
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


def _interval(joint: JointLikelihood, tail: float) -> tuple[Array, Array]:
    """Return the ends of the interval of each pixel."""
    total, largest = joint.total, joint.max_total
    are_bits = joint.sensor.bit_depth == 1
    if joint.uniform:
        distinct, places = np.unique(total, return_inverse=True)
        if largest.flat[0] <= _MAX_EXACT_TOTAL[are_bits]:
            first, last = _exact_ends(joint, distinct.astype(np.int64), tail)
            return first[places].reshape(total.shape), last[places].reshape(total.shape)
        if not are_bits:
            first, last = _normal_ends(joint, distinct, tail)
            return first[places].reshape(total.shape), last[places].reshape(total.shape)
    if not are_bits:
        return _normal_ends(joint, total, tail)
    probabilities = clopper_pearson(total, largest, tail, jots_differ=True)
    low, high = (solve_expected_total(joint, largest * p) for p, _ in probabilities)
    return low, high


def _normal_ends(joint: JointLikelihood, total: Array, tail: float) -> tuple[Array, Array]:
    """Return the intensities at which totals are as many standard deviations off as a tail says."""
    from scipy.special import ndtri

    deviations = -float(ndtri(tail))

    def is_below(intensity: Array, side: float) -> npt.NDArray[np.bool_]:
        mean, _, variance = joint.expected_total(intensity)
        return np.asarray(mean + side * deviations * np.sqrt(variance) < total - side / 2)

    shape, highest = total.shape, joint.sensor.max_intensity
    low, _ = _bisect(lambda intensity: is_below(intensity, 1.0), shape, highest)
    _, high = _bisect(lambda intensity: is_below(intensity, -1.0), shape, highest)
    return low, high


def _bisect(
    is_below: Callable[[Array], npt.NDArray[np.bool_]], shape: tuple[int, ...], highest: float
) -> tuple[Array, Array]:
    """Return the bounds of the highest intensity at which a condition holds."""
    low, high = np.zeros(shape), np.full(shape, highest)
    for _ in range(_STEPS):
        middle = np.sqrt(np.maximum(low, _MIN_RATIO * high) * high)
        below = is_below(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return low, high


def _exact_ends(
    joint: JointLikelihood, ones: npt.NDArray[np.int64], tail: float
) -> tuple[Array, Array]:
    """Return the ends of the intervals of some totals in a uniform image."""
    places, highest = np.arange(len(ones)), joint.sensor.max_intensity

    def cumulative(intensity: Array) -> Array:
        return np.asarray(distribution_of_total(joint.terms, intensity).cumsum(axis=1))

    # At the lower end, the probability of these ones or more is `tail`; at the upper end, that of
    # these or fewer.
    fewer = np.maximum(ones - 1, 0)
    shape = ones.shape
    low, _ = _bisect(lambda x: 1 - cumulative(x)[places, fewer] < tail, shape, highest)
    _, high = _bisect(lambda x: cumulative(x)[places, ones] > tail, shape, highest)
    return np.where(ones > 0, low, 0.0), np.where(ones < joint.max_total.flat[0], high, highest)


def distribution_of_total(terms: tuple[Term, ...], intensity: Array) -> Array:
    """Return the probabilities of totals from 0 to N of a pixel at each intensity, (len, N + 1).

    It is the convolution of the distributions of the groups, which are binomial for bits.

    Examples
    --------
    >>> from jotlight.sensing.bits import Bits
    >>> joint = joint_likelihood(
    ...     Bits.from_array([[[1]], [[0]]]), Sensor(frames=2, gain=[np.log(2), np.log(4)]), None
    ... )
    >>> distribution_of_total(joint.terms, np.array([1.0])).round(4)  # p = 1/2 and 3/4
    array([[0.125, 0.5  , 0.375]])
    """
    from scipy.special import gammaln, xlogy

    length = 1 + sum(term.max_reading * int(float(np.max(term.trials))) for term in terms)
    product = np.ones((len(intensity), length // 2 + 1), np.complex128)
    for term in terms:
        cells, number = term.cells, int(float(np.max(term.trials)))
        if isinstance(cells, ReadingLikelihood):
            one_reading = cells.distribution(term.light * intensity)
            product *= np.fft.rfft(one_reading, length, axis=1) ** number
            continue
        rate = cells.efficiency * term.light * intensity[:, None] + cells.dark_counts
        one = detection_probability(cells.threshold, rate)
        zero = silence_probability(cells.threshold, rate)
        counts = np.arange(number + 1.0)
        logarithms = xlogy(counts, one) + xlogy(number - counts, zero) + gammaln(number + 1)
        logarithms -= gammaln(counts + 1) + gammaln(number - counts + 1)
        product *= np.fft.rfft(np.exp(logarithms), length, axis=1)
    return np.asarray(np.clip(np.fft.irfft(product, length, axis=1), 0, 1))
