"""The brightness of a scene, estimated from its own bits, and the sensor to train a network for."""

from functools import partial

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.estimators.denoise import gaussian
from jotlight.estimators.noniterative import noniterative
from jotlight.sensing.bits import Bits
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor

_BLUR = 3.0
"""The standard deviation in pixels of a Gaussian that keeps noise out of the brightest pixels."""

BRIGHTNESS_QUANTILE = 0.999
"""The share of pixels that are darker than the brightness of the scene."""

HEADROOM = 2.0
"""The largest intensity of a network over the brightness. Highlights exceed the brightness."""


def detected_photons(sensor: Sensor) -> float:
    """Return η α/T: the photons that a pixel of intensity 1 detects per frame.

    η is that of the median jot, so that no single jot affects the result.

    Examples
    --------
    >>> efficiency = np.array([[0.5, 0.5, 1.0]])
    >>> detected_photons(Sensor(frames=10, gain=20.0, efficiency=efficiency))
    1.0
    """
    return reference_jot(sensor)[0] * sensor.gain / sensor.frames


def max_measurable_intensity(sensor: Sensor) -> float:
    """Return the intensity at which a pixel is expected to show L = K - 1/2 ones.

    The bits of brighter pixels are nearly all 1 and hardly distinguish their intensities.

    Examples
    --------
    >>> round(max_measurable_intensity(Sensor(frames=16)), 3)  # -log(1/32)
    3.466
    """
    bits = sensor.bits_per_pixel
    threshold, light, _ = sensor.pixel_response()
    efficiency, dark = reference_jot(sensor)
    rate = engine.inverse_detection_probability(threshold, 1 - 0.5 / bits)
    return max(rate - dark, 1e-12) / (efficiency * light)


def estimate_brightness(
    data: Bits | npt.ArrayLike, sensor: Sensor, *, threads: int | None = None
) -> float:
    """Return the intensity that 99.9 % of the pixels of a scene are darker than.

    Parameters
    ----------
    data : Bits or array_like of int
        Bits, or an image of counts (H, W) or (H, W, C).
    sensor : Sensor
        The sensor that recorded the data. Its `max_intensity` has no effect.
    threads : int, optional
        The number of threads. Default: all cores.

    Returns
    -------
    float
        The quantile of the estimate smoothed by a Gaussian, above 0, in units of intensity.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together.

    Examples
    --------
    >>> sensor = Sensor(frames=64)
    >>> round(estimate_brightness(sensor.expose(np.full((32, 32), 0.3), rng=0), sensor), 1)
    0.3
    """
    max_intensity = max_measurable_intensity(sensor)
    estimate = noniterative(
        data,
        sensor.replace(max_intensity=max_intensity),
        denoiser=partial(gaussian, sigma=_BLUR),
        threads=threads,
    )
    # A capture in darkness still needs a scale.
    return max(float(np.quantile(estimate, BRIGHTNESS_QUANTILE)), 1e-3 * max_intensity)


def training_sensor(
    data: Bits | npt.ArrayLike, sensor: Sensor, *, threads: int | None = None
) -> tuple[Sensor, float]:
    """Return the sensor that a network for this capture is trained for, and the brightness.

    Photographs with intensities in [0, 1], multiplied by the brightness, are training scenes like
    that of the capture.

    Parameters
    ----------
    data, sensor, threads
        As for :func:`estimate_brightness`.

    Returns
    -------
    sensor : Sensor
        The sensor with a `max_intensity` of :data:`HEADROOM` times the brightness.
    brightness : float
        As from :func:`estimate_brightness`.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together.

    Examples
    --------
    >>> bits = Sensor(frames=64).expose(np.full((32, 32), 0.3), rng=0)
    >>> sensor, brightness = training_sensor(bits, Sensor(frames=64))
    >>> round(sensor.max_intensity / brightness)
    2
    """
    brightness = estimate_brightness(data, sensor, threads=threads)
    return sensor.replace(max_intensity=HEADROOM * brightness), brightness
