"""The non-uniformity of the response of jots (PRNU), without the noise of counting."""

import math

import numpy as np
import numpy.typing as npt

from jotlight.calibration.jot_counts import Rates
from jotlight.calibration.light import WINDOW, LocalLight
from jotlight.sensing.response import detection_density, detection_probability

_STEPS = 30
"""Steps from the spread of the counts to that of the response."""


def measure_prnu(
    found: LocalLight, noise: Rates, used: npt.NDArray[np.bool_], dark: Rates, threshold: int
) -> tuple[float, float]:
    """Return the standard deviation of the response over jots, and its standard error.

    The square of the excess of a jot has the mean (slope · PRNU)² + noise. So the sum of the
    squares without noise, divided by that of the squared slopes, is PRNU². Jots in the brightest
    and the darkest parts reveal little, and their small slopes give them small weights.

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
    nodes, weights = np.polynomial.hermite_e.hermegauss(20)
    weights = weights / weights.sum()
    slope = light * float(detection_density(threshold, dark + light))
    mean = float(detection_probability(threshold, dark + light))
    result, own_light = spread, light
    for _ in range(_STEPS if 0 < spread < 1 and slope > 0 else 0):
        rates = dark + own_light * np.maximum(1 + result * nodes, 0)
        values = detection_probability(threshold, rates)
        own_mean = float(weights @ values)
        # The light is that for which the mean of all jots is the measured one.
        own_light *= min(max(1 + (mean - own_mean) / slope, 0.5), 2.0)
        own = math.sqrt(float(weights @ (values - own_mean) ** 2)) / slope
        result = min(result * spread / own, 1.0)
    return result
