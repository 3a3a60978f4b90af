"""The uncertainty of maximum likelihood for readings with different gains and thresholds."""

import functools
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.readings.joint_mle import maximize, regular_maximum, solve_expected_total
from jotlight.estimators.readings.pixel_kinds import PixelKind, find_kinds
from jotlight.estimators.uncertainty import Uncertainty, is_above
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.likelihood.joint_likelihood import JointLikelihood, joint_likelihood
from jotlight.sensing.parameters.binomial import clopper_pearson
from jotlight.sensing.sensor import Sensor
from jotlight.underflow import underflows_to_0

MAX_EXACT_TOTAL = {True: 256, False: 1024}
"""Maximum total of the readings of a pixel, of one bit and of several, whose interval is exact."""

_LENGTHS = np.array([16, 64, 256, 1024])
"""Maximum totals whose intervals are computed together."""

_MIN_PROBABILITY = 1e-300
"""Probability in place of 0, whose logarithm is finite."""

_RANGE = 92.0
"""Logarithm of the range of levels of light in which ends are searched."""

_TOLERANCE = 1e-9
"""Relative accuracy of the ends of exact intervals."""

_MAX_STEPS = 100
"""Maximum number of steps of the search."""

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
        The number of threads. Default: the number of cores.

    Notes
    -----
    The standard error is I^(-1/2), where I is the information of the readings about the intensity,
    at :func:`jotlight.estimators.readings.joint_mle.regular_maximum`.

    The interval is that of the total of the readings L, whose distribution rises with the
    intensity; for bits, it is the number of ones. The probability of L or more at the lower end is
    (1 - `confidence_level`)/2, and so is that of L or less at the upper end. The distribution is
    the exact one, a convolution of those of the readings, if L is at most 256 for bits and 1024
    for readings of several bits, and if the live pixels are of at most 64 kinds
    (:func:`jotlight.estimators.readings.pixel_kinds.find_kinds`). A mask makes a few kinds. Maps of
    efficiency and dark counts make none, unless the jots of a pixel differ, or dark counts differ
    and so do the gains or thresholds. Otherwise that of bits is bounded by the binomial
    distribution with the same mean (Hoeffding 1956), so that the interval is wider than necessary.
    The coverage is at least `confidence_level` in both cases.

    Other totals of several bits are taken as normal, with their exact mean and variance (Wilson
    1927) and half a photon on each side. The coverage is then only about `confidence_level`.
    Intervals are extended to include the estimate.
    """
    each = [
        _uncertainty(joint_likelihood(one, sensor, threads), confidence_level)
        for one in images.data
    ]
    return Uncertainty.arrange(each, images.layout)


@underflows_to_0
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
        saturated=(saturated | is_above(low, joint.sensor.max_intensity))[None],
        dead=dead[None],
        unlikely=np.zeros_like(dead)[None],
        confidence_level=confidence_level,
    )


def _interval(joint: JointLikelihood, tail: float) -> tuple[Array, Array]:
    """Return the ends of the interval of each pixel."""
    total, highest = joint.total.reshape(-1), joint.sensor.max_intensity
    are_bits = joint.sensor.bit_depth == 1
    low, high = np.zeros(total.shape), np.full(total.shape, highest)
    remain = joint.trials.reshape(-1) > 0
    for kind in find_kinds(joint):
        exact = kind.pixels[total[kind.pixels] <= MAX_EXACT_TOTAL[are_bits]]
        if not len(exact):
            continue
        own = kind.select(exact)
        low[exact], high[exact] = _exact_ends(own, total[exact], tail, highest)
        remain[exact] = False
    if remain.any():
        ends = _bounded_ends if are_bits else _normal_ends
        rest = ends(joint, tail)
        low[remain], high[remain] = (end.reshape(-1)[remain] for end in rest)
    return low.reshape(joint.shape), high.reshape(joint.shape)


def _bounded_ends(joint: JointLikelihood, tail: float) -> tuple[Array, Array]:
    """Return the ends for numbers of ones, from the binomial distribution that bounds theirs."""
    largest = joint.max_total
    probabilities = clopper_pearson(joint.total, largest, tail, jots_differ=True)
    low, high = (solve_expected_total(joint, largest * p) for p, _ in probabilities)
    return low, high


def _normal_ends(joint: JointLikelihood, tail: float) -> tuple[Array, Array]:
    """Return the intensities at which totals are as many standard deviations off as a tail says."""
    from scipy.special import ndtri

    deviations = -float(ndtri(tail))
    total, places = joint.total, None
    if joint.uniform:
        total, places = np.unique(total, return_inverse=True)

    def is_below(intensity: Array, side: float) -> npt.NDArray[np.bool_]:
        mean, _, variance = joint.expected_total(intensity)
        return np.asarray(mean + side * deviations * np.sqrt(variance) < total - side / 2)

    shape, highest = total.shape, joint.sensor.max_intensity
    low, _ = _bisect(lambda intensity: is_below(intensity, 1.0), shape, highest)
    _, high = _bisect(lambda intensity: is_below(intensity, -1.0), shape, highest)
    if places is None:
        return low, high
    return low[places].reshape(joint.shape), high[places].reshape(joint.shape)


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


def _exact_ends(kind: PixelKind, total: Array, tail: float, highest: float) -> tuple[Array, Array]:
    """Return the ends of the intervals of some totals of pixels of one kind."""
    distinct, places = np.unique(total.astype(np.int64), return_inverse=True)
    max_level = float(np.max(kind.scale * highest + kind.offset))
    low, high = np.zeros(len(distinct)), np.full(len(distinct), max_level)
    # Short distributions suffice for small totals.
    for longest in np.unique(_LENGTHS[np.searchsorted(_LENGTHS, distinct)]):
        own = np.flatnonzero(_LENGTHS[np.searchsorted(_LENGTHS, distinct)] == longest)
        low[own], high[own] = _level_ends(kind, distinct[own], tail, max_level)
    ends = ((end[places] - kind.offset) / kind.scale for end in (low, high))
    low, high = (np.clip(end, 0, highest) for end in ends)
    return low, high


def _level_ends(
    kind: PixelKind, total: npt.NDArray[np.int64], tail: float, max_level: float
) -> tuple[Array, Array]:
    """Return the levels of light at the ends of the intervals of some totals."""
    length = int(total.max()) + 1

    def excess(level: Array, places: npt.NDArray[np.int64], *, is_low: bool) -> Array:
        """Return what rises with the level, and is 0 at an end."""
        cumulative = kind.distribution(level, length).cumsum(axis=1)
        rows, own = np.arange(len(level)), total[places]
        if is_low:  # the probability of this total or more is `tail`
            rest = 1 - cumulative[rows, np.maximum(own - 1, 0)]
            return np.asarray(np.log(np.maximum(rest, _MIN_PROBABILITY) / tail))
        return np.asarray(-np.log(np.maximum(cumulative[rows, own], _MIN_PROBABILITY) / tail))

    number = len(total)
    low, _ = find_zeros(functools.partial(excess, is_low=True), number, max_level)
    _, high = find_zeros(functools.partial(excess, is_low=False), number, max_level)
    return np.where(total > 0, low, 0.0), np.where(total < kind.max_total, high, max_level)


def find_zeros(
    function: Callable[[Array, npt.NDArray[np.int64]], Array], number: int, highest: float
) -> tuple[Array, Array]:
    """Return close bounds of the zeros of rising functions of positive numbers up to `highest`.

    Parameters
    ----------
    function : callable
        It takes numbers and the places of their functions.
    number : int
        The number of functions.
    highest : float
        The bound where the zero of a function is larger.

    Notes
    -----
    Chandrupatla (1997): bisection of the logarithm, with inverse quadratic interpolation where
    this is safe.

    Examples
    --------
    >>> find_zeros(lambda x, places: x - np.array([0.5, 3.0])[places], 2, 2.0)[0].round(6)
    array([0.5, 2. ])
    """
    low, high = np.zeros(number), np.full(number, highest)
    places = np.arange(number)
    x1, x2 = np.full(number, np.log(highest)), np.full(number, np.log(highest) - _RANGE)
    f1, f2 = function(np.exp(x1), places), function(np.exp(x2), places)
    low[f1 < 0], high[f2 >= 0] = highest, np.exp(x2[f2 >= 0])
    share = np.full(number, 0.5)
    is_open = (f1 >= 0) & (f2 < 0)
    for _ in range(_MAX_STEPS):
        places, share = places[is_open], share[is_open]
        x1, x2, f1, f2 = (values[is_open] for values in (x1, x2, f1, f2))
        if not len(places):
            break
        x = x1 + share * (x2 - x1)
        f = function(np.exp(x), places)
        same = np.sign(f) == np.sign(f1)
        x3, f3 = np.where(same, x1, x2), np.where(same, f1, f2)
        x2, f2 = np.where(same, x2, x1), np.where(same, f2, f1)
        x1, f1 = x, f
        other = np.where(f1 == 0, x1, x2)
        low[places], high[places] = np.exp(np.minimum(x1, other)), np.exp(np.maximum(x1, other))
        least = _TOLERANCE / np.abs(x2 - x1)
        xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
        is_safe = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = f1 / (f2 - f1) * f3 / (f2 - f3)
            inverse += (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        share = np.clip(np.where(is_safe, inverse, 0.5), least, 1 - least)
        is_open = (least < 0.5) & (f1 != 0)
    return low, high
