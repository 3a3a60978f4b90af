"""Intervals where readings tell less about the light than their equivalent counts."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.readings.neighbors import min_intensity
from jotlight.estimators.readings.reference_sensors import live_share, reference_sensor
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.intervals.stabilized import stabilize
from jotlight.sensing.likelihood.reference import reading_information, reference_jot
from jotlight.sensing.sensor import Sensor

_NODES = 1025
"""Number of intensities at which the information is computed. Others are interpolated."""


def widen_intervals(
    found: Uncertainty, estimate: npt.NDArray[np.floating], sensor: Sensor
) -> Uncertainty:
    """Return the uncertainty with intervals that begin where the readings' information says.

    Equivalent counts tell as much as the readings at the estimate only. Farther away, readings may
    tell less: those of a bracket with threshold 8 tell nearly nothing about light that is below all
    of its thresholds, but trials with threshold 1 do. So each lower end moves down until it is as
    many standard deviations from the estimate for the readings as it was for the counts. The number
    of standard deviations is the integral of √I over the intensity, where I is the information of
    the median jots of a pixel. No lower end moves up. Upper ends stay. Saturated pixels have a rule
    of their own, and near them errors are those of edges, which do not follow the information.

    Parameters
    ----------
    found : Uncertainty
        The uncertainty by equivalent counts, in units of intensity.
    estimate : ndarray of float
        The estimate.
    sensor : Sensor
        The sensor of the readings.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=2, threshold=8, gain=[1.0, 64.0])
    >>> image = np.full((1, 1), 0.04, np.float32)  # 2.6 photons
    >>> flags = dict.fromkeys(("unlit", "saturated", "dead", "unlikely"), image > 1)
    >>> found = jl.Uncertainty(image / 8, image / 2, 2 * image, **flags, confidence_level=0.95)
    >>> wider = widen_intervals(found, image, sensor)
    >>> found.low.tolist(), wider.low.tolist()
    ([[0.0199...]], [[0.0]])
    """
    reference, light = reference_sensor(sensor), _nodes(sensor)
    information = _information(sensor, light)
    distance = _integral(np.sqrt(information), light)

    def deviations(intensity: Array) -> Array:
        return 2 * stabilize(intensity, reference, *reference_jot(reference))

    own, low = (each.astype(np.float64) for each in (estimate, found.low))
    per_trial = _information_of_reading(reference, light)
    trials = information / np.maximum(per_trial, np.finfo(np.float64).tiny)
    scale = np.sqrt(np.interp(own, light, trials))
    place = np.interp(own, light, distance) - scale * (deviations(own) - deviations(low))
    lower = np.minimum(low, np.interp(place, distance, light)).astype(np.float32)
    # Where intervals began at 0 before, it is known whether pixels are unlit.
    is_moved = (lower <= 0) & (found.low > 0) & ~found.dead
    return dataclasses.replace(found, low=lower, unlit=found.unlit | is_moved)


def _nodes(sensor: Sensor) -> Array:
    """Return intensities from 0 to S."""
    least = min_intensity(sensor)
    return np.concatenate([[0.0], np.geomspace(least, sensor.max_intensity, _NODES - 1)])


def _information(sensor: Sensor, intensity: Array) -> Array:
    """Return the information of the live median jots of a pixel about its intensity."""
    total = np.zeros(intensity.shape)
    for group in sensor.groups():
        number = group.sensor.trials * live_share(group.sensor)
        total += number * _information_of_reading(group.sensor, intensity)
    return total


def _information_of_reading(sensor: Sensor, intensity: Array) -> Array:
    """Return the information of a reading of a median jot about the intensity of its pixel.

    At intensity 0, it is that at the next one, because it may be infinite at 0.
    """
    light = sensor.light_per_intensity
    return light**2 * reading_information(sensor, light * np.maximum(intensity, intensity[1]))


def _integral(values: Array, nodes: Array) -> Array:
    """Return the integral of values from the first node to each node, by trapezoids."""
    steps = np.diff(nodes) * (values[1:] + values[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])
