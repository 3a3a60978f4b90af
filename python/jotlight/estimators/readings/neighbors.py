"""Intensities that the readings of a pixel and of its neighbors have in common."""

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.merge_readings import min_light
from jotlight.estimators.readings.joint_mle import solve_expected_total
from jotlight.estimators.readings.reference_sensors import half_rate
from jotlight.sensing.likelihood.joint_likelihood import JointLikelihood
from jotlight.sensing.sensor import Sensor

_SIGMA, _MIN_SIGMA, _MAX_SIGMA = 4.0, 1.0, 3.0
"""Standard deviation of an average in pixels, for one reading per pixel, and its limits. For n
readings, it is divided by √n. The noise of narrow averages of few readings biases the counts."""

_ENOUGH, _MAX_WIDE_SIGMA = 20.0, 32.0
"""Information that an average has about the logarithm of its light, so that the light has a
relative error of at most 1/√20, and the largest standard deviation of such an average, in pixels.
In dim scenes, narrow averages are so noisy that dark ones get too much weight."""

MAX_FILTERS = 16
"""With more filters, an average is wider, so that it has as many pixels of its own filter. Beyond
this number, it grows no further."""

_MIN_SHARE = 1e-5
"""Smallest intensity near which readings are linear, as a share of the largest one, or of the one
that saturates half of the most sensitive readings, whichever is dimmer."""

_STEPS = 3
"""Number of steps toward the most likely light of a neighborhood. More change nothing visible."""

MAX_FRACTION = 1 - 1e-6
"""Largest fraction of ones of an average."""

_HALFWAY = 100.0
"""Square of the signal-to-noise ratio of a pixel at which readings are merged halfway between the
given and the most likely intensity. At edges, averages and estimates are far from both sides, and
counts are linear only near the true intensity."""

_POWER = 3
"""Power of this square with which the weight of the most likely intensity rises."""


def typical_spread(readings: float, information: float) -> float:
    """Return the standard deviation of an average in pixels.

    Parameters
    ----------
    readings : float
        The number of readings of a pixel.
    information : float
        The Fisher information of a pixel about the logarithm of its light. In dim scenes, it is the
        number of photons.

    Examples
    --------
    >>> [typical_spread(readings, information=4.0) for readings in (1, 4, 100)]
    [3.0, 2.0, 1.0]
    >>> round(typical_spread(4, information=0.02), 1)
    8.9
    """
    spread = min(max(_SIGMA / np.sqrt(max(readings, 1)), _MIN_SIGMA), _MAX_SIGMA)
    least = _ENOUGH / averaged_pixels(_MAX_WIDE_SIGMA)
    return float(max(spread, _MAX_WIDE_SIGMA * np.sqrt(least / max(information, least))))


def averaged_pixels(sigma: float) -> float:
    """Return how many pixels a Gaussian average is worth: the noise of their mean is the same.

    Examples
    --------
    >>> round(averaged_pixels(1.0), 2)
    12.57
    """
    return 4 * np.pi * sigma**2


def min_intensity(sensor: Sensor) -> float:
    """Return the smallest intensity near which readings become linear counts.

    Examples
    --------
    >>> min_intensity(jl.Sensor(gain=0.1))
    1e-05
    >>> round(min_intensity(jl.Sensor(frames=2, gain=[0.01, 69.315])), 9)
    1e-07
    """
    dimmest = sensor.max_intensity
    for group in sensor.groups():
        dimmest = min(dimmest, half_rate(group.sensor) / group.sensor.light_per_intensity)
    return _MIN_SHARE * dimmest


def common_intensity(
    joint: JointLikelihood, spread: float, pattern: npt.NDArray[np.integer] | None
) -> Array:
    """Return the intensity at which the sum of the readings around each pixel is expected, (H, W).

    It is not too dark where most, but not all, readings are saturated. If all readings of an
    average are, it is the intensity at which their sum is expected to be 0.5 lower. If all are 0,
    it is the intensity at which their sum is expected to be 0.5.
    """
    from scipy.ndimage import gaussian_filter

    fraction = np.zeros(joint.shape)
    for own in each_filter(pattern, joint.shape):
        sigma = own_sigma(spread, own)
        total, largest = (
            gaussian_filter(np.where(own, part, 0.0), sigma)
            for part in (joint.total, joint.max_total)
        )
        half = 0.5 / averaged_pixels(sigma)
        inside = np.minimum(np.maximum(total, half), largest - half)
        fraction = np.where(own, inside / np.maximum(largest, 1e-9), fraction)
    near = solve_expected_total(joint, np.clip(fraction, 0, 1) * joint.max_total)
    if np.ndim(joint.sensor.efficiency) == np.ndim(joint.sensor.dark_counts) == 0:
        return near
    light = near
    for own in each_filter(pattern, joint.shape):
        light = np.where(own, _most_likely(joint, near, own, own_sigma(spread, own)), light)
    return light


def _most_likely(
    joint: JointLikelihood, start: Array, own: npt.NDArray[np.bool_], sigma: float
) -> Array:
    """Return the most likely intensity of each pixel and its neighbors, whose jots differ, (H, W).

    The likelihood of a neighborhood has Gaussian weights, and is maximized by Fisher scoring. Only
    the pixels of one filter are in it.
    """
    from scipy.ndimage import gaussian_filter

    def average(values: Array) -> Array:
        return np.asarray(gaussian_filter(np.where(own, values, 0.0), sigma))

    def derivatives(light: Array) -> tuple[Array, Array]:
        return average(joint.gradient_and_curvature(light)[0]), average(joint.information(light))

    least = np.maximum(min_intensity(joint.sensor), min_light(joint))
    first = np.maximum(average(start) / np.maximum(average(np.ones(joint.shape)), 1e-9), least)
    return fisher_scoring(first, derivatives, least, joint.sensor.max_intensity)


def fisher_scoring(
    start: Array,
    derivatives: Callable[[Array], tuple[Array, Array]],
    least: float | Array,
    largest: float = np.inf,
) -> Array:
    """Return the most likely light or intensity, by a few steps of Newton's method.

    The information replaces the curvature, so each step is ``x + ℓ'(x)/I(x)``.

    Parameters
    ----------
    start : ndarray
        The first guess.
    derivatives : callable
        A function that returns ℓ' and I, where ℓ is the log-likelihood.
    least, largest : float or ndarray
        The limits of the result.

    Examples
    --------
    >>> def derivatives(x):  # of 3 ones among 4 bits
    ...     return 3 / np.expm1(x) - 1, 4 / np.expm1(x)
    >>> fisher_scoring(np.ones(1), derivatives, 0.0).round(4)  # log(4)
    array([1.3863])
    """
    light = start
    for _ in range(_STEPS):
        gradient, information = derivatives(light)
        step = np.divide(gradient, information, out=np.zeros(light.shape), where=information > 0)
        light = np.clip(light + step, least, largest)
    return light


def average_fractions(
    ones: npt.NDArray[np.number],
    trials: Array,
    spread: float = 1.0,
    pattern: npt.NDArray[np.integer] | None = None,
) -> Array:
    """Return the fraction of ones of each pixel and its neighbors with the same filter, (H, W).

    The ones of an average count as half a one or more, because bits with a high threshold tell
    nothing about darkness. At most half of its trials are ones by this rule.

    Parameters
    ----------
    ones, trials : ndarray of shape (H, W)
        Gray counts. They may be real numbers.
    spread : float
        Standard deviation of an average in pixels if all have the same filter.
    pattern : ndarray of int, shape (H, W), optional
        The filter of each pixel. Default: all have the same one.
    """
    from scipy.ndimage import gaussian_filter

    fraction = np.zeros(ones.shape)
    for own in each_filter(pattern, ones.shape):
        sigma = own_sigma(spread, own)
        total, number = (
            gaussian_filter(np.where(own, part, 0.0), sigma) for part in (ones, trials)
        )
        total = np.maximum(total, np.minimum(0.5 / averaged_pixels(sigma), number / 2))
        fraction = np.where(own, total / np.maximum(number, 1e-9), fraction)
    return np.asarray(np.clip(fraction, 0, MAX_FRACTION))


def own_sigma(spread: float, own: npt.NDArray[np.bool_]) -> float:
    """Return the standard deviation of an average that has as many pixels of a filter as of all."""
    return float(spread / np.sqrt(max(own.mean(), 1 / MAX_FILTERS)))


def each_filter(
    pattern: npt.NDArray[np.integer] | None, shape: tuple[int, ...]
) -> Iterator[npt.NDArray[np.bool_]]:
    """Yield the pixels (H, W) of each filter."""
    if pattern is None:
        yield np.ones(shape, bool)
    else:
        yield from (pattern == each for each in np.unique(pattern))


def toward_own(near: Array, own: Array, information: Array, halfway: float = _HALFWAY) -> Array:
    """Return intensities between given ones and those of the pixels themselves, (H, W).

    Parameters
    ----------
    near, own : ndarray of float64, shape (H, W)
        The given intensities, and the most likely ones.
    information : ndarray of float64, shape (H, W)
        The Fisher information of the readings of each pixel.
    halfway : float
        The square of the signal-to-noise ratio of a pixel at which the result is halfway.

    Examples
    --------
    >>> near, own = np.full((1, 3), 1.0), np.full((1, 3), 1.2)
    >>> toward_own(near, own, np.array([[1.0, 100.0, 10_000.0]])).round(3).tolist()
    [[1.0, 1.1, 1.2]]
    """
    # The power keeps the noise of pixels with a low ratio out: it would bias saturated readings.
    ratio = (information * near**2 / halfway) ** _POWER
    return np.asarray(near + ratio / (ratio + 1) * (own - near))
