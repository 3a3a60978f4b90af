"""Dark regions: the mean of an estimate is that of the bits.

Networks were trained for scenes in which ones are frequent. Where nearly no bit is 1, they return
probabilities of about 1e-3, which may be far too large. With a threshold q, the intensity is about
p^(1/q) there, so dark regions looked bright. Yet the bits of a neighborhood show its mean well. So
the probability p of a one becomes::

    p r^m,    r = f(sum of g m N) / f(sum of g m K p),
    f(n) = (Γ(n + 3/(2q)) / Γ(n + 1/(2q)))^q,

where m = 1 / (1 + (p / p0)²) selects dark pixels, and N is the number of ones of K bits. The
weights g of a Gaussian window sum to 4 π σ² pixels. f(n) is the number of ones that are expected at
the mean intensity x, if n ones were observed, their expected number is proportional to x^q, and the
prior is 1/√x. For q = 1, it is n + 1/2. Where the sum of K p is so small that f is f(0), nothing
changes.

Where p is even smaller, its differences between pixels are those of the filters of the network,
and not of the scene. There, it first becomes its own mean in the window.
"""

import math

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.blur import blur
from jotlight.estimators.trial_levels import LocalTrials
from jotlight.sensing.likelihood.reference import response_of
from jotlight.sensing.sensor import Sensor

_DARK = 5e-3
"""p0: a pixel is dark if its probability of a one is below about this value."""

_EMPTY = 5e-4
"""p1: below about this value, p becomes its mean in the window."""

_SIGMA = 8.0
"""Standard deviation of the window in pixels."""


_TINY = np.finfo(np.float32).tiny
"""Smallest result, because smaller numbers of float32 are inaccurate, or 0."""

_MAX_EXPONENT = 80.0
"""Largest exponent whose exponential is a number of float32."""


def may_have_dark_regions(image: Image, sensor: Sensor) -> bool:
    """Return whether an estimate has dark pixels whose brightness would be wrong.

    For a threshold of 1, a wrong small p is a wrong small intensity, which matters little.

    Parameters
    ----------
    image : ndarray of float32, shape (H, W)
        The estimate.
    sensor : Sensor
        The sensor.

    Examples
    --------
    >>> image = np.full((4, 4), 0.1, np.float32)
    >>> several = jl.Sensor(frames=16, gain=16.0, threshold=3)
    >>> may_have_dark_regions(image, several), may_have_dark_regions(image, jl.Sensor(frames=16))
    (True, False)
    """
    if sensor.threshold == 1:
        return False
    return float(response_of(sensor)(np.array(image.min(), np.float64))) < _DARK


def match_dark_regions(
    probability: Image,
    fraction: Image,
    trials: LocalTrials,
    threshold: int,
    threads: int | None = None,
) -> Image:
    """Return probabilities of a one whose means in dark regions are those of the bits, (H, W).

    Parameters
    ----------
    probability : ndarray of float32, shape (H, W)
        Probabilities by a network.
    fraction : ndarray of float32, shape (H, W)
        Fractions of ones.
    trials : int or ndarray of float32, shape (H, W)
        The local number of trials.
    threshold : int
        The threshold q.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> wrong, zeros = np.full((8, 8), 1e-3, np.float32), np.zeros((8, 8), np.float32)
    >>> for threshold in (1, 4):
    ...     print(f"{match_dark_regions(wrong, zeros, 64, threshold).mean():.1e}")
    1.2e-05
    2.8e-07
    """
    p = np.maximum(probability, 0)
    if float(p.min()) >= _DARK:
        return probability
    empty = _below(p, _EMPTY)
    number, sums = blur(np.stack([empty * trials, empty * trials * p]), _SIGMA, threads)
    p = p + empty * (sums / np.maximum(number, 1e-12) - p)
    dark = _below(p, _DARK)
    bits = dark * trials
    pixels = 4 * math.pi * _SIGMA**2  # pixels that a Gaussian window weighs like a uniform one
    ones, expected = blur(np.stack([bits * fraction, bits * p]), _SIGMA, threads)
    logarithm = _log_of_expected(pixels * ones, threshold)
    logarithm -= _log_of_expected(pixels * expected, threshold)
    # A probability is at most 1, so larger exponents would change nothing.
    ratio = np.exp(np.minimum(dark * logarithm, _MAX_EXPONENT))
    return np.asarray(np.clip(p * ratio, np.minimum(p, _TINY), 1), np.float32)


def _log_of_expected(ones: Image, threshold: int) -> npt.NDArray[np.float64]:
    """Return log f(n), whose exponential may underflow for a high threshold."""
    n = ones.astype(np.float64)
    if threshold == 1:
        return np.log(n + 0.5)
    from scipy.special import gammaln

    ratio = gammaln(n + 1.5 / threshold) - gammaln(n + 0.5 / threshold)
    return np.asarray(threshold * ratio)


def _below(p: Image, limit: float) -> Image:
    """Return about 1 where p is below a limit, and about 0 where it is far above."""
    return np.asarray(1 / (1 + (p / limit) ** 2), np.float32)
