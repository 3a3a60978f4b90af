"""Equivalent counts near estimates of the intensities, for methods that take counts."""

import dataclasses
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from jotlight.estimators.demosaicing import COLORS, brightest_mean, demosaic
from jotlight.estimators.joint_mle import maximize, solve_expected_total
from jotlight.estimators.merge_readings import (
    MAX_TRIALS,
    linear_counts,
    mean_jots,
    merge_joint,
    min_light,
    reference_sensor,
)
from jotlight.estimators.whole_counts import carry_debts, diffuse
from jotlight.sensing.joint_likelihood import JointLikelihood
from jotlight.sensing.merged import MAX_SILENT_TRIALS, Merged
from jotlight.sensing.mosaic import Mosaic, Pattern
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.response import Array, inverse_detection_probability
from jotlight.sensing.sensor import Sensor

_MIN_SHARE = 1e-5
"""Smallest intensity near which readings are merged, as a share of the largest one."""

_SIGMA, _MIN_SIGMA, _MAX_SIGMA = 4.0, 1.0, 3.0
"""Standard deviation of an average in pixels, for one reading per pixel, and its limits. For n
readings, it is divided by √n. The noise of narrow averages of few readings biases the counts."""

_MAX_FILTERS = 16
"""With more filters, an average is wider, so that it has as many pixels of its own filter. Beyond
this number, it grows no further."""

_MAP_SIGMA = 0.4
"""Standard deviation of the filter of the counts, in pixels, for maps of thresholds.

Some of their pixels say much and their neighbors little, and denoisers take both for equally good.
"""

_ALIKE = 0.9
"""Fraction of the pixels with the same thresholds from which pixels count as alike. If the jots of
each pixel have all thresholds, an average would only hide noise from denoisers and intervals."""

_HALFWAY = 100.0
"""Square of the signal-to-noise ratio of a pixel at which readings are merged halfway between the
given and the most likely intensity. At edges, averages and estimates are far from both sides, and
counts are linear only near the true intensity."""

_POWER = 3
"""Power of this square with which the weight of the most likely intensity rises."""

_MAX_FRACTION = 1 - 1e-6
"""Largest fraction of ones of an average."""


def merge_near_neighbors(joint: JointLikelihood, mosaic: Mosaic | None = None) -> Merged:
    """Return counts as :func:`merge_near` does, near averages over the neighbors of each pixel.

    Parameters
    ----------
    joint : JointLikelihood
        The likelihood of the readings.
    mosaic : Mosaic, optional
        The filters. Only neighbors with the same one are averaged. If there are more than three
        filters, their averages become colors, as the information behind each filter permits.

    Examples
    --------
    >>> from jotlight.sensing.bits import Bits
    >>> from jotlight.sensing.joint_likelihood import joint_likelihood
    >>> from jotlight.sensing.sensor import Sensor
    >>> sensor = Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0])
    >>> bits = sensor.expose(np.full((64, 64), 0.6), rng=0)
    >>> merged = merge_near_neighbors(joint_likelihood(bits, sensor, None))
    >>> bool(abs(merged.ones.sum() / merged.trials.sum() - (1 - np.exp(-0.6))) < 0.02)
    True
    """
    if joint.sensor.has_plain_bits:
        return merge_joint(joint)
    readings = float(np.mean(joint.trials))
    sigma = min(max(_SIGMA / np.sqrt(max(readings, 1)), _MIN_SIGMA), _MAX_SIGMA)
    pattern = None if mosaic is None else mosaic.full(*joint.shape)
    near = _average(joint, sigma, pattern)
    if mosaic is not None and pattern is not None and len(np.unique(pattern)) > COLORS:
        near = _behind_filters(joint, near, mosaic, pattern)
    return merge_near(joint, near, pattern)


def _behind_filters(joint: JointLikelihood, near: Array, mosaic: Mosaic, pattern: Pattern) -> Array:
    """Return the intensities behind the filters of the colors that averages determine, (H, W).

    Where clear pixels are saturated, their own averages would be too dark.
    """
    sensitivity = mosaic.sensitivity[pattern]
    values = near / sensitivity
    bright = brightest_mean(values, pattern) * sensitivity
    known = joint.information(np.maximum(bright, _MIN_SHARE * joint.sensor.max_intensity))
    weights = np.where(joint.trials > 0, known * sensitivity**2, 0.0)
    plain = dataclasses.replace(mosaic, white_balance=np.ones(COLORS))
    colors = demosaic(values, plain, "differences", weights)
    return np.asarray(mosaic.light(np.maximum(colors, 0)))


def _average(joint: JointLikelihood, spread: float, pattern: Pattern | None) -> Array:
    """Return the intensity that the readings around each pixel have in common, (H, W).

    It is that at which their sum is expected. The sums of pixels with different thresholds cannot
    be compared. So each kind of pixels has averages of its own first, and the equivalent counts
    near them are averaged.
    """
    if np.ndim(joint.sensor.threshold) < 2:
        return _expecting_sums(joint, spread, pattern)
    kinds = _kinds_of_pixels(joint, pattern)
    if kinds.max() < _MAX_FILTERS:
        ones, trials = _real_counts(joint, _expecting_sums(joint, spread, kinds))[:2]
    else:
        merged = merge_joint(joint)
        ones, trials = merged.ones.astype(np.float64), np.broadcast_to(merged.trials, joint.shape)
    return _intensity(average_fractions(ones, trials, spread, pattern), joint.sensor)


def _intensity(fraction: Array, sensor: Sensor) -> Array:
    """Return the intensity at which equivalent counts have a fraction of ones, (H, W)."""
    reference = reference_sensor(sensor)
    efficiency, dark_counts = _jots_of_counts(sensor, reference)
    one = np.clip(fraction, 0, _MAX_FRACTION)
    rate = inverse_detection_probability(1, one, 1 - one) - dark_counts
    slope = np.maximum(efficiency, 1e-9) * reference.light_per_intensity
    return np.asarray(np.maximum(rate, 0) / slope)


def _jots_of_counts(sensor: Sensor, reference: Sensor) -> tuple[float | Array, float | Array]:
    """Return the efficiency and the dark counts of the jots to which equivalent counts refer.

    These are the jots of each pixel. Counts of a map of thresholds are averaged over neighbors, so
    all of them refer to the same jot.
    """
    return reference_jot(reference) if np.ndim(sensor.threshold) == 2 else mean_jots(reference)


def _kinds_of_pixels(joint: JointLikelihood, pattern: Pattern | None) -> Pattern:
    """Return whole numbers from 0 that tell filters and thresholds of pixels apart, (H, W)."""
    each = [term.sum_pixels(term.trials) > 0 for term in joint.terms]
    rows = np.stack([*each, np.zeros(joint.shape) if pattern is None else pattern])
    kinds = np.unique(rows.reshape(len(rows), -1), axis=1, return_inverse=True)[1]
    return np.asarray(kinds.reshape(joint.shape))


def _thresholds_of_pixels_differ(joint: JointLikelihood) -> bool:
    if np.ndim(joint.sensor.threshold) < 2:
        return False
    kinds = _kinds_of_pixels(joint, None)
    return bool(np.bincount(kinds.ravel()).max() < _ALIKE * kinds.size)


def _expecting_sums(joint: JointLikelihood, spread: float, pattern: Pattern | None) -> Array:
    """Return the intensity at which the sum of the readings around each pixel is expected, (H, W).

    It is not too dark where most, but not all, readings are saturated. If all readings of an
    average are, it is the intensity at which their sum is expected to be 0.5 lower. If all are 0,
    it is the intensity at which their sum is expected to be 0.5.
    """
    from scipy.ndimage import gaussian_filter

    fraction = np.zeros(joint.shape)
    for own in _of_each_filter(pattern, joint.shape):
        sigma = _own_sigma(spread, own)
        total, largest = (
            gaussian_filter(np.where(own, part, 0.0), sigma)
            for part in (joint.total, joint.max_total)
        )
        half = 0.5 / (4 * np.pi * sigma**2)
        inside = np.minimum(np.maximum(total, half), largest - half)
        fraction = np.where(own, inside / np.maximum(largest, 1e-9), fraction)
    return solve_expected_total(joint, np.clip(fraction, 0, 1) * joint.max_total)


def average_fractions(
    ones: npt.NDArray[np.number],
    trials: Array,
    spread: float = 1.0,
    pattern: npt.NDArray[np.integer] | None = None,
) -> Array:
    """Return the fraction of ones of each pixel and its neighbors with the same filter, (H, W).

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
    for own in _of_each_filter(pattern, ones.shape):
        sigma = _own_sigma(spread, own)
        total, number = (
            gaussian_filter(np.where(own, part, 0.0), sigma) for part in (ones, trials)
        )
        fraction = np.where(own, total / np.maximum(number, 1e-9), fraction)
    return np.asarray(np.clip(fraction, 0, _MAX_FRACTION))


def _own_sigma(spread: float, own: npt.NDArray[np.bool_]) -> float:
    """Return the standard deviation of an average that has as many pixels of a filter as of all."""
    return float(spread / np.sqrt(max(own.mean(), 1 / _MAX_FILTERS)))


def merge_near(
    joint: JointLikelihood,
    intensity: npt.NDArray[np.floating],
    pattern: npt.NDArray[np.integer] | None = None,
) -> Merged:
    """Return counts whose likelihood near given intensities is close to that of the readings.

    The derivative of the log-likelihood and the information are those at the given intensities.
    :func:`jotlight.merge_readings` takes them at the most likely intensity of each pixel. So the
    trials do not depend on the noise of a pixel, and the ones are a linear function of its
    readings, without bias. The higher the signal-to-noise ratio of a pixel, the closer the
    intensity is to the most likely one instead: halfway at a ratio of 10. At a high ratio, the most
    likely intensity is usually closer to the truth than the given one.

    Pixels of less than one trial are completed to one, which agrees with the given intensity. The
    ones are rounded such that the errors of neighbors cancel. Where rounding makes more ones than
    trials, the next pixels have fewer trials. Where the thresholds of pixels differ, counts are
    averaged over the nearest neighbors, unless there is a mosaic.

    Parameters
    ----------
    joint : JointLikelihood
        The likelihood of the readings.
    intensity : ndarray of float, shape (H, W)
        Intensities in [0, S] near the true ones, with the S of the sensor of the likelihood.
    pattern : ndarray of int, shape (H, W), optional
        The filter of each pixel of a mosaic. Errors of rounding cancel among pixels with the same
        filter. Default: all pixels have the same one.

    Examples
    --------
    >>> from jotlight.sensing.bits import Bits
    >>> from jotlight.sensing.joint_likelihood import joint_likelihood
    >>> from jotlight.sensing.sensor import Sensor
    >>> sensor = Sensor(frames=2, gain=[1.0, 3.0], max_intensity=9.0)
    >>> joint = joint_likelihood(Bits.from_array(np.ones((2, 1, 100), bool)), sensor, None)
    >>> merged = merge_near(joint, np.full((1, 100), 0.5))
    >>> int(merged.ones.sum()), round(float(merged.trials.sum()))
    (199, 268)
    """
    from scipy.ndimage import gaussian_filter

    near, differ = intensity.astype(np.float64), _thresholds_of_pixels_differ(joint)
    if not differ:  # counts of a map of thresholds are averaged, so their intensities stay
        least = _MIN_SHARE * joint.sensor.max_intensity
        near = toward_own(near, maximize(joint), joint.information(np.maximum(near, least)))
    ones, trials, rate = _real_counts(joint, near)
    reference = reference_sensor(joint.sensor)
    efficiency, dark_counts = _jots_of_counts(joint.sensor, reference)
    # Denoisers take each pixel for at least one trial, and 0 ones of fewer trials for darkness.
    missing = np.where(joint.trials > 0, np.maximum(1 - trials, 0), 0.0)
    ones, trials = ones - missing * np.expm1(-rate), trials + missing
    if pattern is None and differ:
        ones, trials = (gaussian_filter(part, _MAP_SIGMA) for part in (ones, trials))
    trials = np.minimum(trials, MAX_TRIALS)
    ones = np.minimum(ones, MAX_TRIALS)
    whole, zeros = np.zeros(ones.shape), np.zeros(ones.shape)
    for own in _of_each_filter(pattern, ones.shape):
        whole += diffuse(np.where(own, ones, 0.0), own & (trials > 0))
        zeros += carry_debts(np.where(own, trials - whole, 0.0))
    trials = np.where(whole + zeros > 0, whole + zeros, np.minimum(trials, MAX_SILENT_TRIALS))
    return Merged(whole.astype(np.int32), trials, reference, dark_counts, efficiency)


def toward_own(near: Array, own: Array, information: Array) -> Array:
    """Return intensities between given ones and those of the pixels themselves, (H, W).

    Parameters
    ----------
    near, own : ndarray of float64, shape (H, W)
        The given intensities, and the most likely ones.
    information : ndarray of float64, shape (H, W)
        The Fisher information of the readings of each pixel.

    Examples
    --------
    >>> near, own = np.full((1, 3), 1.0), np.full((1, 3), 1.2)
    >>> toward_own(near, own, np.array([[1.0, 100.0, 10_000.0]])).round(3).tolist()
    [[1.0, 1.1, 1.2]]
    """
    # The power keeps the noise of pixels with a low ratio out: it would bias saturated readings.
    ratio = (information * near**2 / _HALFWAY) ** _POWER
    return np.asarray(near + ratio / (ratio + 1) * (own - near))


def _real_counts(
    joint: JointLikelihood, intensity: npt.NDArray[np.floating]
) -> tuple[Array, Array, Array]:
    """Return the ones and the trials near intensities, and the rates of a trial there, (H, W)."""
    reference, largest = reference_sensor(joint.sensor), joint.sensor.max_intensity
    efficiency, dark_counts = _jots_of_counts(joint.sensor, reference)
    least = np.maximum(_MIN_SHARE * largest, min_light(joint))
    near = np.clip(intensity.astype(np.float64), least, largest)
    slope = efficiency * reference.light_per_intensity
    rate = np.asarray(slope * near + dark_counts)
    is_known = joint.trials > 0
    gradient = np.where(is_known, joint.gradient_and_curvature(near)[0], 0.0)
    information = np.where(is_known, joint.information(near), 0.0)
    return *linear_counts(gradient, information, slope, rate, rate), rate


def _of_each_filter(
    pattern: npt.NDArray[np.integer] | None, shape: tuple[int, ...]
) -> Iterator[npt.NDArray[np.bool_]]:
    """Yield the pixels (H, W) of each filter."""
    if pattern is None:
        yield np.ones(shape, bool)
    else:
        yield from (pattern == each for each in np.unique(pattern))
