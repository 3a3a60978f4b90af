"""About how many trials the equivalent counts of a sensor have."""

import numpy as np

from jotlight.estimators.merge_readings import linear_counts, mean_jots
from jotlight.estimators.readings.reference_sensors import live_share, reference_sensor
from jotlight.sensing.likelihood.reference import reading_information
from jotlight.sensing.sensor import Sensor

_TYPICAL_INTENSITY = 0.45
"""Share of the largest intensity: about the mean of photographs."""


def typical_trials(sensor: Sensor) -> float:
    """Return about how many trials the equivalent counts of a sensor have per pixel.

    They are those at 0.45 times the largest intensity, about the mean of photographs.

    Examples
    --------
    >>> typical_trials(jl.Sensor(frames=16))
    16.0
    >>> round(typical_trials(jl.Sensor(frames=64, gain=64.0, bit_depth=3)))
    271
    """
    if sensor.has_plain_bits:
        return float(sensor.trials)
    live = max(live_share(sensor), 1e-9)
    reference, intensity = reference_sensor(sensor), _TYPICAL_INTENSITY * sensor.max_intensity
    information = 0.0
    for group in sensor.groups():
        own = group.sensor
        share = live_share(own) / live
        light = np.array([own.light_per_intensity * intensity])
        each = own.trials * own.light_per_intensity**2 * reading_information(own, light)[0]
        information += share * each
    efficiency, dark_counts = (float(np.mean(part)) for part in mean_jots(reference))
    slope = efficiency * reference.light_per_intensity
    rate = np.array(slope * intensity + dark_counts)
    threshold = int(reference.threshold)
    trials = linear_counts(np.array(0.0), np.array(information), slope, rate, rate, threshold)[1]
    return float(trials)
