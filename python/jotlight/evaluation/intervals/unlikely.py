"""Where held-out bits contradict an estimate, and by how much."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.evaluation.intervals.error_scale import HalfErrors
from jotlight.sensing.parameters.binomial import arcsin_root

_NEIGHBORHOOD = 6.0
"""Standard deviation of the neighborhood whose held-out bits decide together, in pixels."""

_CERTAINTY = 3.0
"""Number of standard deviations by which held-out bits must be less probable."""

_WINDOW = 11
"""Side of the window whose ones are added up, in pixels."""

_STEP = 4.0
"""Ratio of the probabilities of a one that separate classes of pixels. Ones are added up within a
class only: the many ones of a bright object would hide those that are missing beside it."""

_DARKEST = 1e-12
"""Probabilities of a one below it are in one class."""

_MAX_FALSE = 1e-6
"""Largest probability that noise alone makes the sum of a window contradict the estimate."""


def find_contradictions(
    halves: Sequence[HalfErrors],
) -> tuple[npt.NDArray[np.bool_], tuple[Array, Array]]:
    """Return where held-out bits contradict an estimate, and the least squared errors of z there.

    The errors are those by which the estimate is too bright, and too dark. All are (H, W). There
    are two contradictions:

    - In the neighborhood of a pixel, the held-out bits are more probable under the fraction of ones
      of each pixel alone. So the error is at least that of such fractions.
    - In a window, the sum of the ones of alike pixels is not what the estimate predicts. In dark
      regions, single pixels predict bits even worse than a wrong estimate does, but sums do not.
    """
    trials = np.mean([half.trials for half in halves], axis=0)
    of_pixels = np.where(_is_improbable(halves), 1 / (4 * trials), 0.0)
    bright, dark = (np.maximum(of_pixels, each**2) for each in _errors_of_sums(halves))
    return (bright > 0) | (dark > 0), (bright, dark)


def _is_improbable(halves: Sequence[HalfErrors]) -> npt.NDArray[np.bool_]:
    """Return where single pixels predict the held-out bits better than the estimate."""
    from scipy.ndimage import gaussian_filter

    gain = np.sum([half.gain for half in halves], axis=0)
    mean = gaussian_filter(gain, _NEIGHBORHOOD, mode="mirror")
    variance = gaussian_filter((gain - mean) ** 2, _NEIGHBORHOOD, mode="mirror")
    deviation = np.sqrt(variance / (4 * np.pi)) / _NEIGHBORHOOD
    return np.asarray(mean < -_CERTAINTY * deviation)


def _errors_of_sums(halves: Sequence[HalfErrors]) -> Array:
    """Return the errors of z that sums of held-out ones show beyond doubt, or 0, (2, H, W).

    The first ones are those of estimates that are too bright, and the others of those too dark.

    The ones of alike pixels in a window are compared with those that the estimate from the other
    half of the bits predicts. By Bernstein's inequality, a sum deviates from its expectation by t
    or more with a probability of at most 2 exp(-t²/(2 (variance + t/3))). If that is below 1e-6,
    the error is the difference between z of both sums, for all alike pixels of the window.
    """
    from scipy.ndimage import maximum_filter, uniform_filter

    sums = np.sum([_terms(half) for half in halves], axis=0)
    trials, _, expected, *_ = sums
    p = expected / np.maximum(trials, 1)
    classes = np.floor(np.log(np.maximum(p, _DARKEST)) / math.log(_STEP))
    found = np.zeros((2, *p.shape))
    for each in np.unique(classes):
        own = (classes == each) & (trials > 0)
        means = uniform_filter(own * sums, (1, _WINDOW, _WINDOW), mode="constant")
        error = _error_of(*np.maximum(_WINDOW**2 * means, 0))  # without rounding errors below 0
        for sign, largest in zip((1, -1), found, strict=True):
            errors = np.where(own, np.maximum(sign * error, 0.0), 0.0)
            largest[own] = maximum_filter(errors, _WINDOW)[own]
    return found


def _terms(half: HalfErrors) -> Array:
    """Return the held-out trials, ones, expected ones, variance, and slope of pixels, (5, H, W).

    The slope is that of arcsin √p with respect to z, times the trials.
    """
    number = np.where(half.known, half.held_out.trials, 0)
    ones = np.where(half.known, half.held_out.ones, 0)
    expected = number * half.p
    variance = expected * (1 - half.p)
    return np.stack([number, ones, expected, variance, number * half.relative_slope])


def _error_of(trials: Array, ones: Array, expected: Array, variance: Array, slope: Array) -> Array:
    """Return the error of z that sums show, above 0 if z is too large, or 0 if it may be noise."""
    logarithm = math.log(2 / _MAX_FALSE)
    limit = logarithm / 3 + np.sqrt(logarithm**2 / 9 + 2 * logarithm * variance)
    seen, predicted = (arcsin_root(each / np.maximum(trials, 1)) for each in (ones, expected))
    error = (predicted - seen) * trials / np.maximum(slope, np.finfo(np.float64).tiny)
    return np.where(np.abs(ones - expected) > limit, error, 0.0)
