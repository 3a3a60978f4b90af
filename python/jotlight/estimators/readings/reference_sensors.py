"""The reference sensor of equivalent counts: its gain, and its dark counts."""

import math

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.sensing.likelihood.multibit import ReadingLikelihood
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.parameters.response import JotResponse, inverse_detection_probability
from jotlight.sensing.sensor import Sensor

MAX_TRIALS = 2.0**30
"""Maximum number of equivalent trials. Counts are 32-bit integers."""

MAX_RATE = 0.25
"""Rate of a jot of the reference sensor at the largest intensity, or at the light that saturates
half of the readings, for readings of several bits. With so little light, the number of trials
hardly depends on the estimate, which is noisy itself."""

_MAX_DARK_COUNTS = 3.0
"""Maximum dark counts of a jot of the reference sensor. With more, nearly all of its bits would be
ones, and a count that is rounded to a whole number would say something else."""


def reference_sensor(sensor: Sensor) -> Sensor:
    """Return the sensor with one gain and threshold 1 to which equivalent counts refer.

    At the light at which half of the least sensitive readings are ones, half of its bits are ones.
    So it is not saturated where the readings are not, and its trials are at least about as many as
    those of the least sensitive readings. For readings of several bits, a jot of it has the rate
    1/4, at the largest intensity or at the light that saturates half of the readings, whichever is
    dimmer, but at most as much light as in the readings. A jot gets more light if dark pixels
    needed more than :data:`MAX_TRIALS` trials otherwise.

    Examples
    --------
    >>> reference_sensor(jl.Sensor(frames=4, gain=[2.0, 2.0, 16.0, 16.0])).gain
    8.0
    """
    if sensor.has_plain_bits and sensor.threshold == 1:
        return sensor
    per_frame, photons = [], 0.0
    for group in sensor.groups():
        own = group.sensor
        rate = half_rate(own)
        share = math.log(2) / rate
        if own.bit_depth > 1:
            brightest = own.light_per_intensity * own.max_intensity + reference_jot(own).dark_counts
            share = min(1.0, MAX_RATE / min(brightest, rate))
        per_frame.append(own.gain / own.frames * share)
        photons += own.gain / own.frames * len(group.frames)
    # In the dark, trials that would receive as many photons say as much as the readings.
    least = photons * sensor.oversampling**2 / MAX_TRIALS
    gain = max(min(per_frame), least) * sensor.frames
    reference = sensor.replace(threshold=1, gain=gain, bit_depth=1, read_noise=0.0)
    dark_counts = reference_dark_counts(sensor, reference, sensor.dark_counts)
    return reference.replace(dark_counts=dark_counts)


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

    A jot of the reference sensor gets a share of the light, and the same share of the dark counts,
    but at most 3. Read noise counts as dark counts of the same variance, or as fewer, with which
    bits tell as much about darkness as the readings.

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
    dark = np.asarray(dark_counts, np.float64)
    share = reference.light_per_intensity / min(
        group.sensor.light_per_intensity for group in sensor.groups()
    )
    found = (1.0 if math.isclose(share, 1) else share) * (dark + sensor.read_noise**2)
    if sensor.read_noise:
        found = np.minimum(found, _noise_floor(sensor, reference, dark))
    found = np.minimum(found, _MAX_DARK_COUNTS)
    return float(found) if dark.ndim == 0 else np.asarray(found)


def _noise_floor(sensor: Sensor, reference: Sensor, dark: Array) -> Array:
    """Return the dark counts with which bits tell as much about darkness as readings with noise.

    With dark counts d, T bits have the information T (α/K)² / (exp(d) - 1) about intensity 0. T is
    the number of bits that receive as much light as the readings: as many without a one say as much
    as readings that are all 0. Readings of several bits count as whether they are 0: the
    information of larger ones, which are rare in the dark, vanishes with the least light.
    """
    distinct, places = np.unique(dark, return_inverse=True)
    information, total_light = np.zeros(len(distinct)), 0.0
    for group in sensor.groups():
        own, light = group.sensor, group.sensor.light_per_intensity
        response = JotResponse(1, own.read_noise, own.threshold)
        none = np.zeros((len(distinct), 0), np.int32)
        cells = ReadingLikelihood(response, none, False, 1.0, distinct)
        share = 1.0 if own.mask is None else float(1 - own.mask.mean())
        total_light += len(group.frames) * share * light
        information += len(group.frames) * share * light**2 * cells.information_per_reading(0.0)
    # Far from darkness, a reading of 0 is so rare that its information vanishes.
    with np.errstate(divide="ignore", over="ignore"):
        floor = np.log1p(total_light * reference.light_per_intensity / information)
    return np.asarray(floor[places].reshape(dark.shape))
