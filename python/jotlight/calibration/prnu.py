"""The non-uniformity of the response of jots (PRNU), without the noise of counting."""

import math

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.calibration.light import WINDOW, LocalLight
from jotlight.sensing.parameters.response import detection_density, detection_probability

_LIGHT_REACH = 7.0
"""The logarithm of the light that explains the mean of all jots is at most this far from that of
the usual light."""

_MAX_ONES = 1 - 1e-9
"""Fraction of ones above which the spread of the counts is not corrected: there are no zeros."""


def measure_prnu(
    found: LocalLight, noise: Array, used: npt.NDArray[np.bool_], dark: Array, threshold: int
) -> tuple[float, float]:
    """Return the standard deviation of the response over jots, and its standard error.

    The square of the excess of a jot has the mean (slope · PRNU)² + noise. So the sum of the
    squares without noise, divided by that of the squared slopes, is PRNU². Jots in the brightest
    and the darkest parts reveal little, and they have small weights by their small slopes.

    Parameters
    ----------
    found : LocalLight
        The light on each jot, and what jots report beyond it.
    noise : ndarray of float64
        An unbiased estimate of the variance of the counting noise in the excess of each jot.
    used : ndarray of bool
        The jots that are no outliers.
    dark : ndarray of float64
        Dark counts per frame.
    threshold : int
        q.

    Notes
    -----
    The jot takes part in the mean of its window of n jots, so its excess is 1 - 1/n of that beyond
    the true mean. The error is that of a mean of independent jots. Two of these errors are a
    confidence interval of about 95 %, also near 0, where the square root is not linear.
    """
    used = used & _inner(used.shape)
    n = np.maximum(found.neighbors[used], 2)
    terms = found.excess[used] ** 2 * n / (n - 1) - noise[used]
    weights = found.slope[used] ** 2
    slopes = float(weights.sum())
    if slopes == 0:
        return 0.0, 1.0  # the jots reveal nothing
    # A curved falloff of the light shifts all jots alike.
    shift = float((found.excess * found.slope)[used].sum()) / slopes
    measured = float(terms.sum()) / slopes - shift**2
    variance = max(measured, 0.0)
    error = 2 * float(np.std(terms - measured * weights)) * np.sqrt(n.size) / slopes
    light, usual = (float(np.average(each[used], weights=weights)) for each in (found.light, dark))

    def spread(value: float) -> float:
        return _from_counts(math.sqrt(max(value, 0.0)), light, usual, threshold)

    limits = [abs(spread(variance + sign * error) - spread(variance)) for sign in (-1, 1)]
    return spread(variance), max(limits) / 2


def _inner(shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    """Return the jots in the centers of their windows, or all of a small sensor.

    The light at the border is that of jots further inside, which differs.
    """
    inner = np.zeros(shape, bool)
    border = tuple(WINDOW // 2 if size >= 2 * WINDOW else 0 for size in shape)
    inner[tuple(slice(width, size - width) for width, size in zip(border, shape, strict=True))] = 1
    return inner


def _from_counts(spread: float, light: float, dark: float, threshold: int) -> float:
    """Return the spread of the response from the one that P(q, s) has, divided by the slope.

    P(q, s) is not a straight line, so the two differ for a large spread. The response is taken to
    be normal.

    Examples
    --------
    >>> round(_from_counts(0.1, 1e-6, 0.0, 1), 4)  # straight
    0.1
    >>> spread = math.sqrt(math.expm1(0.3**2)) / 2.955  # exp(-3 r) is log-normal
    >>> round(_from_counts(spread, 2.955, 0.0, 1), 4)  # 2.955 = 3 - 0.3²/2
    0.1
    """
    from scipy.optimize import brentq

    slope = light * float(detection_density(threshold, dark + light))
    mean = float(detection_probability(threshold, dark + light))
    if not (0 < spread < 1 and slope > 0 and mean < _MAX_ONES):
        return spread
    nodes, weights = np.polynomial.hermite_e.hermegauss(20)
    weights = weights / weights.sum()

    def excess(result: float) -> float:
        responses = np.maximum(1 + result * nodes, 0)

        def values(log_light: float) -> Array:
            rates = dark + math.exp(log_light) * responses
            return np.asarray(detection_probability(threshold, rates))

        def mean_excess(log_light: float) -> float:
            return float(weights @ values(log_light)) - mean

        # The light is that for which the mean of all jots is the measured one.
        low, high = (math.log(light) + sign * _LIGHT_REACH for sign in (-1, 1))
        if mean_excess(low) >= 0 or mean_excess(high) <= 0:
            return 1.0  # the mean allows fewer jots without a response
        own = values(brentq(mean_excess, low, high)) - mean
        return math.sqrt(float(weights @ own**2)) / slope - spread

    return float(brentq(excess, 0, 1)) if excess(1.0) > 0 else 1.0
