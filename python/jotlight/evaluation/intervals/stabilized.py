"""z = arcsin √p of intensities, whose noise is nearly the same at every exposure."""

import numpy as np

from jotlight.array_types import Array
from jotlight.sensing.parameters.binomial import squared_sine
from jotlight.sensing.parameters.response import (
    detection_density,
    detection_probability,
    intensity_at_probability,
    silence_probability,
)
from jotlight.sensing.sensor import Sensor


def stabilize(
    intensity: Array, sensor: Sensor, efficiency: float | Array, dark_counts: float | Array
) -> Array:
    """Return z = arcsin √p of the probability p that a bit is 1.

    Parameters
    ----------
    intensity : ndarray, shape (H, W)
        Intensities of 0 or more.
    sensor : Sensor
        The sensor.
    efficiency, dark_counts : float or ndarray, shape (H, W)
        η and d of the pixels.

    Examples
    --------
    >>> stabilize(np.array([[0.0, np.log(2)]]), jl.Sensor(), 1.0, 0.0).round(4)  # π/4
    array([[0.    , 0.7854]])
    """
    rate = efficiency * sensor.light_per_intensity * intensity + dark_counts
    p, rest = (
        detection_probability(sensor.threshold, rate),
        silence_probability(sensor.threshold, rate),
    )
    return np.asarray(np.arctan2(np.sqrt(p), np.sqrt(rest)))


def intensity_of(
    z: Array, sensor: Sensor, efficiency: float | Array, dark_counts: float | Array
) -> Array:
    """Return the intensity in [0, S] of z: the inverse of :func:`stabilize`."""
    z = np.clip(z, 0, np.pi / 2)
    p, complement = squared_sine(z), np.cos(z) ** 2
    slope = efficiency * sensor.light_per_intensity
    intensity = intensity_at_probability(sensor.threshold, p, complement, slope, dark_counts)
    # The cosine of the number next to π/2 is not 0, but a saturated jot permits all bright light.
    intensity = np.where(z < np.pi / 2, intensity, sensor.max_intensity)
    return np.asarray(np.clip(intensity, 0, sensor.max_intensity))


def slope_of(
    intensity: Array, sensor: Sensor, efficiency: float | Array, dark_counts: float | Array
) -> Array:
    """Return the derivative of z with respect to the light of a jot, η c / (2 √[p (1 - p)]).

    The parameters are those of :func:`stabilize`. Where a jot is saturated, it is 0.

    Examples
    --------
    >>> z = stabilize(np.array([[0.5, 0.5001]]), jl.Sensor(), 1.0, 0.0)
    >>> slope = slope_of(np.array([[0.5]]), jl.Sensor(), 1.0, 0.0)
    >>> bool(abs((z[0, 1] - z[0, 0]) / 1e-4 - slope[0, 0]) < 1e-3)
    True
    """
    rate = efficiency * sensor.light_per_intensity * intensity + dark_counts
    variance = detection_probability(sensor.threshold, rate) * silence_probability(
        sensor.threshold, rate
    )
    change = efficiency * detection_density(sensor.threshold, rate)
    noise = 2 * np.sqrt(variance)
    return np.asarray(np.divide(change, noise, out=np.zeros_like(noise), where=noise > 0))
