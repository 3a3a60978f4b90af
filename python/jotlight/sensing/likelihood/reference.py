"""Numbers that represent a whole sensor: its median jot, and its saturation intensity."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.likelihood.multibit import ReadingLikelihood
from jotlight.sensing.parameters.maps import LIMITS
from jotlight.sensing.parameters.response import (
    detection_probability,
    inverse_detection_probability,
)
from jotlight.sensing.sensor import Sensor


class Jot(NamedTuple):
    """The efficiency η and the dark counts d of a jot."""

    efficiency: float
    dark_counts: float


def reference_jot(sensor: Sensor) -> Jot:
    """Return the median efficiency and the median dark counts of the live jots.

    Examples
    --------
    >>> reference_jot(jl.Sensor(efficiency=np.array([[0.5, 0.5, 1.0]]), dark_counts=0.1))
    Jot(efficiency=0.5, dark_counts=0.1)
    """
    medians = [
        float(np.median(_of_live_jots(value, sensor))) if isinstance(value, np.ndarray) else value
        for value in (sensor.efficiency, sensor.dark_counts)
    ]
    return Jot(*medians)


def sensor_of_median_jot(sensor: Sensor) -> Sensor:
    """Return the sensor without maps whose jots are like the median one, for a prediction.

    A map of efficiency, such as that of a calibration, may be known only up to a factor. With a
    map, the light of the returned sensor is what the median jot detects: its efficiency is 1.

    Parameters
    ----------
    sensor : Sensor
        A sensor whose readings have one gain and one threshold.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=4, efficiency=np.array([[0.25, 0.5, 1.0]]), dark_counts=0.1)
    >>> sensor_of_median_jot(sensor)
    Sensor(frames=4, gain=2.0, dark_counts=0.1)
    """
    efficiency, dark_counts = reference_jot(sensor)
    changes = {"efficiency": efficiency, "dark_counts": dark_counts, "mask": None}
    if isinstance(sensor.efficiency, np.ndarray):
        changes |= {"efficiency": 1.0, "gain": sensor.gain * efficiency}
    return sensor.replace(**changes)


def typical_jot(
    trials: float | Array, efficiency: float | Array, dark_counts: float | Array
) -> Jot:
    """Return the median efficiency and the median dark counts of the pixels with trials.

    Examples
    --------
    >>> typical_jot(np.array([[4.0, 4.0, 0.0]]), np.array([[0.5, 0.7, 1e-3]]), 0.1)
    Jot(efficiency=0.6, dark_counts=0.1)
    """
    medians = []
    for value in (efficiency, dark_counts):
        live = value
        if isinstance(value, np.ndarray) and isinstance(trials, np.ndarray) and trials.any():
            live = value[np.broadcast_to(trials, value.shape) > 0]
        medians.append(float(np.median(live)))
    return Jot(*medians)


def reading_information(sensor: Sensor, light: npt.ArrayLike) -> Array:
    """Return the Fisher information of one reading of the median jot about each light.

    Examples
    --------
    >>> several = jl.Sensor(bit_depth=4)
    >>> reading_information(several, [1.0]).round(4)  # nearly that of a Poisson count, 1 / light
    array([1.])
    """
    levels = np.asarray(light, np.float64)
    efficiency, dark_counts = reference_jot(sensor)
    if sensor.has_plain_bits:
        bit = Likelihood(
            np.zeros(levels.shape, np.int32),
            threshold=sensor.threshold,
            efficiency=efficiency,
            dark_counts=dark_counts,
        )
        return bit.information(levels)
    none = np.zeros((1, 0), np.int32)
    jot = ReadingLikelihood(sensor.jot_response(), none, False, efficiency, dark_counts)
    return jot.information_per_reading(levels)


def saturation_intensity(sensor: Sensor) -> float:
    """Return a maximum intensity S that clips only pixels whose readings are all the largest one.

    At S, a pixel whose jots are the least sensitive ones is expected to show K - 1/2 ones. The
    estimate from K - 1 ones is therefore below S. A pixel with K ones is saturated: without a
    limit its estimate would be infinite, and it is S. If dark counts alone saturate the readings,
    no intensity can be measured, and S is 1.

    Examples
    --------
    >>> round(saturation_intensity(jl.Sensor(frames=16)), 4)  # log(2 * 16)
    3.4657

    Where the readings differ in their gain or threshold, it is that of the least sensitive ones.
    """
    if sensor.readings_differ:
        return max(saturation_intensity(group.sensor) for group in sensor.groups())
    dark, efficiency = (
        float(_of_live_jots(value, sensor).min()) if isinstance(value, np.ndarray) else float(value)
        for value in (sensor.dark_counts, sensor.efficiency)
    )
    rate = saturation_rate(sensor, sensor.trials)
    light = max(rate - dark, 0.0) / efficiency
    intensity = light / sensor.light_per_intensity or 1.0
    return min(max(intensity, LIMITS[0]), LIMITS[1])


def saturation_rate(sensor: Sensor, trials: int) -> float:
    """Return the detections per reading at which half of a reading is not the largest one.

    Parameters
    ----------
    sensor : Sensor
        A sensor whose readings have one gain and one threshold.
    trials : int
        The number of readings.

    Examples
    --------
    >>> round(saturation_rate(jl.Sensor(), 16), 4)  # log(2 * 16)
    3.4657
    """
    half = 0.5 / trials
    # The photons at which a reading is the largest one.
    photons = sensor.threshold - 1 + sensor.max_reading
    rate = float(inverse_detection_probability(photons, 1 - half, half))
    if sensor.read_noise:
        from scipy.special import ndtri

        rate += sensor.read_noise * float(-ndtri(half))
    return rate


def _of_live_jots(map_: npt.NDArray[np.float32], sensor: Sensor) -> npt.NDArray[np.float32]:
    """Return the values of the live jots. If all jots are dead, return all values."""
    return map_ if sensor.mask is None or sensor.mask.all() else map_[~sensor.mask]


def response_of(sensor: Sensor) -> Callable[[Array], Array]:
    """Return the function from intensities to P(b = 1) of the median jot.

    Examples
    --------
    >>> response_of(jl.Sensor(dark_counts=0.1))(np.array([0.0, 1.0])).round(4).tolist()
    [0.0952, 0.6671]
    """
    efficiency, dark_counts = reference_jot(sensor)

    def to_probability(intensity: Array) -> Array:
        rate = efficiency * sensor.light_per_intensity * np.maximum(intensity, 0) + dark_counts
        return detection_probability(sensor.threshold, rate)

    return to_probability
