"""The reference sensor of equivalent counts: its threshold, its gain, and its dark counts."""

import math

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.sensing.likelihood.multibit import ReadingLikelihood, reading_probability
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.parameters.reading_groups import ReadingGroup
from jotlight.sensing.parameters.response import JotResponse, inverse_detection_probability
from jotlight.sensing.sensor import Sensor

MAX_TRIALS = 2.0**30
"""Maximum number of equivalent trials. Counts are 32-bit integers."""

MAX_RATE = 0.25
"""Rate of a jot of the reference sensor at the largest intensity, or at the light that saturates
half of the readings, for readings of several bits. With so little light, the number of trials
hardly depends on the estimate, which is noisy itself."""

_FEW_PHOTONS = 2.0
"""Light of a jot and frame below which noise lets few photons make many of the ones."""

_MAX_NOISY_THRESHOLD = 4
"""Largest threshold for which so dim bits have ones at all."""

_MAX_DARK = 1 - math.exp(-3.0)
"""Maximum fraction of ones of the reference sensor in darkness. With more, nearly all of its bits
would be ones, and rounding a count to a whole number would change what it says."""


def reference_sensor(sensor: Sensor) -> Sensor:
    """Return the sensor with one gain and one threshold to which equivalent counts refer.

    Its threshold is 1 for readings of several bits, and for bits with different gains or thresholds
    that respond over a wide range of light, as in a bracket. For bits that are nearly alike, it is
    nearly theirs. With a lower one, few trials would tell much about light far below or far above
    these thresholds, about which the readings tell nothing. With read noise, bits respond to less
    light than their threshold says. So it is also 1 for dim bits with thresholds up to 4.

    Half of its bits are ones at the light at which half of the least sensitive readings are ones.
    So it is not saturated where the readings are not, and its trials are at least about as many as
    those of the least sensitive readings. For readings of several bits, its jots have the rate 1/4
    at the largest intensity, or at the light that saturates half of the readings if this is dimmer.
    But they get at most as much light as in the readings. They get more light if dark pixels would
    otherwise need more than :data:`MAX_TRIALS` trials.

    Examples
    --------
    >>> reference_sensor(jl.Sensor(frames=4, gain=[2.0, 2.0, 16.0, 16.0])).gain
    8.0
    >>> reference_sensor(jl.Sensor(frames=4, gain=40.0, threshold=10, read_noise=0.3))
    Sensor(frames=4, gain=40.0, threshold=10, ...)
    """
    if sensor.has_plain_bits and sensor.threshold == 1:
        return sensor
    threshold = _typical_threshold(sensor)
    half = float(inverse_detection_probability(threshold, 0.5, 0.5))
    per_frame, photons = [], 0.0
    for group in sensor.groups():
        own = group.sensor
        rate = half_rate(own)
        share = half / rate
        if own.bit_depth > 1:
            brightest = own.light_per_intensity * own.max_intensity + reference_jot(own).dark_counts
            share = min(1.0, MAX_RATE / min(brightest, rate))
        per_frame.append(own.gain / own.frames * share)
        photons += own.gain / own.frames * len(group.frames)
    # In the dark, trials that would receive as many photons say as much as the readings.
    least = photons * sensor.oversampling**2 / MAX_TRIALS
    gain = max(min(per_frame), least) * sensor.frames
    reference = sensor.replace(threshold=threshold, gain=gain, bit_depth=1, read_noise=0.0)
    dark_counts = reference_dark_counts(sensor, reference, sensor.dark_counts)
    return reference.replace(dark_counts=dark_counts)


def _typical_threshold(sensor: Sensor) -> int:
    """Return the threshold whose bits respond over as wide a range of light as the readings.

    A bit with threshold q is 1 if its rate exceeds a random number, which has the gamma
    distribution of the shape q. The logarithm of this number has the mean ψ(q) and the variance
    ψ'(q). Read noise adds to this variance. If the readings differ, so does the variance of their
    means.
    """
    if sensor.bit_depth > 1:
        return 1  # such readings are like a bracket of thresholds from 1 upward
    if sensor.read_noise and all(_is_dim(group.sensor) for group in sensor.groups()):
        return 1  # with noise, few photons make most of the ones, as with a low threshold
    from scipy.special import polygamma, psi

    groups = sensor.groups()
    thresholds = np.array([float(group.sensor.threshold) for group in groups])
    light = np.array([group.sensor.light_per_intensity for group in groups])
    weights = np.maximum([_live_frames(group) for group in groups], 1e-9)
    rates = np.exp(psi(thresholds))
    centers = np.log(rates / light)
    squares = (centers - np.average(centers, weights=weights)) ** 2
    noise = polygamma(1, thresholds) + (sensor.read_noise / rates) ** 2
    variance = np.average(noise + squares, weights=weights)
    candidates = np.arange(1, int(thresholds.max()) + 1)
    distances = np.abs(np.log(polygamma(1, candidates) / variance))
    return int(candidates[np.argmin(distances)])


def _is_dim(sensor: Sensor) -> bool:
    """Return whether few photons, fewer than the threshold, make many of the ones, by noise."""
    brightest = sensor.light_per_intensity * sensor.max_intensity
    return brightest < _FEW_PHOTONS and sensor.threshold <= _MAX_NOISY_THRESHOLD


def _live_frames(group: ReadingGroup[Sensor]) -> float:
    """Return the mean number of readings of a jot that are in a group."""
    return len(group.frames) * live_share(group.sensor)


def live_share(sensor: Sensor) -> float:
    """Return the fraction of the jots that are not dead."""
    return 1.0 if sensor.mask is None else 1 - float(np.mean(sensor.mask))


def light_share(sensor: Sensor, reference: Sensor) -> float | None:
    """Return the light of a jot of the reference sensor as a share of that in a frame.

    It is the `light_share` of :class:`jotlight.sensing.merged.Merged`: None if the gains of the
    frames differ.

    Examples
    --------
    >>> several = jl.Sensor(frames=4, gain=64.0, bit_depth=4)
    >>> round(light_share(several, reference_sensor(several)), 4)  # 1/4 of 14.7 photons
    0.017
    """
    if np.ndim(sensor.gain):
        return None
    return reference.light_per_intensity / sensor.light_per_intensity


def half_rate(sensor: Sensor) -> float:
    """Return the rate of a jot at which half of its readings are the largest one.

    Examples
    --------
    >>> round(half_rate(jl.Sensor()), 4), round(half_rate(jl.Sensor(bit_depth=2)), 4)  # log(2)
    (0.6931, 2.6741)
    """
    photons = sensor.threshold - 1 + sensor.max_reading
    return float(inverse_detection_probability(photons, 0.5, 0.5))


def reference_dark_counts(
    sensor: Sensor, reference: Sensor, dark_counts: float | npt.NDArray[np.floating]
) -> float | Array:
    """Return the dark counts of the reference sensor in place of dark counts and read noise.

    A jot of the reference sensor gets a share of the light, and the same share of the dark counts.
    At most 95 % of its bits are ones in darkness. Read noise counts as dark counts of the same
    variance, or as fewer. With threshold 1, they are at most those with which bits tell as much
    about darkness as the readings. With a higher threshold, they are at most those with which bits
    are ones in darkness as often as the readings.

    Parameters
    ----------
    sensor : Sensor
        The sensor of the readings.
    reference : Sensor
        Their reference sensor. Its dark counts do not matter.
    dark_counts : float or ndarray of float
        Dark counts of the readings, of any shape.

    Examples
    --------
    >>> sensor = jl.Sensor(bit_depth=8, gain=100.0)
    >>> reference_dark_counts(sensor, sensor.replace(gain=0.25), 40.0)
    0.1
    """
    dark, threshold = np.asarray(dark_counts, np.float64), int(reference.threshold)
    share = reference.light_per_intensity / min(
        group.sensor.light_per_intensity for group in sensor.groups()
    )
    found = (1.0 if math.isclose(share, 1) else share) * (dark + sensor.read_noise**2)
    if sensor.read_noise:
        distinct, places = np.unique(dark, return_inverse=True)
        floor = _as_informative if threshold == 1 else _as_often_ones
        found = np.minimum(found, floor(sensor, reference, distinct)[places].reshape(dark.shape))
    largest = inverse_detection_probability(threshold, _MAX_DARK, 1 - _MAX_DARK)
    found = np.minimum(found, largest)
    return float(found) if dark.ndim == 0 else np.asarray(found)


def _as_informative(sensor: Sensor, reference: Sensor, dark: Array) -> Array:
    """Return the dark counts with which bits tell as much about darkness as readings with noise.

    With dark counts d, T bits have the information T (α/K)² / (exp(d) - 1) about intensity 0. T is
    the number of bits that receive as much light as the readings. If none of them is 1, they say as
    much as readings that are all 0. Of a reading of several bits, only counts whether it is 0: the
    information of larger readings, which are rare in the dark, vanishes with the least light.
    """
    information, total_light = np.zeros(len(dark)), 0.0
    for group in sensor.groups():
        own, light = group.sensor, group.sensor.light_per_intensity
        response = JotResponse(1, own.read_noise, own.threshold)
        none = np.zeros((len(dark), 0), np.int32)
        cells = ReadingLikelihood(response, none, False, 1.0, dark)
        number = _live_frames(group)
        total_light += number * light
        information += number * light**2 * cells.information_per_reading(0.0)
    # Far from darkness, a reading of 0 is so rare that its information vanishes.
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray(np.log1p(total_light * reference.light_per_intensity / information))


def _as_often_ones(sensor: Sensor, reference: Sensor, dark: Array) -> Array:
    """Return the dark counts with which bits are ones in darkness as often as noisy readings.

    Bits with a threshold above 1 tell nearly nothing about darkness, so their information does not
    determine the dark counts.
    """
    groups = sensor.groups()
    each = [
        reading_probability(
            1, dark, read_noise=group.sensor.read_noise, threshold=int(group.sensor.threshold)
        )
        for group in groups
    ]
    weights = np.maximum([_live_frames(group) for group in groups], 1e-9)
    mean = np.average(each, axis=0, weights=weights)
    return inverse_detection_probability(int(reference.threshold), mean, 1 - mean)
