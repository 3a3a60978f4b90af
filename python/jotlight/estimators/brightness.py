"""How bright a scene is, as its own bits tell: what a network for it should be trained for."""

from functools import partial

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.estimators import denoise
from jotlight.estimators.noniterative import noniterative
from jotlight.sensing.bits import Bits
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor

_BLUR = 3.0
"""Pixels; so that noise does not make the brightest parts brighter."""

BRIGHTNESS_QUANTILE = 0.999
"""Share of the pixels that are darker than what counts as the scene's brightness."""

HEADROOM = 2.0
"""How far above the scene's brightness a network's largest intensity lies: highlights are small."""


def detected_photons(sensor: Sensor) -> float:
    """Give the photons that a pixel of intensity 1 detects per frame: η α/T.

    η is that of the median jot, so that no single jot, however bright, has a say in it.

    Examples
    --------
    >>> efficiency = np.array([[0.5, 0.5, 1.0]])
    >>> detected_photons(Sensor(frames=10, gain=20.0, efficiency=efficiency))
    1.0
    """
    return reference_jot(sensor)[0] * sensor.gain / sensor.frames


def max_measurable_intensity(sensor: Sensor) -> float:
    """Give the intensity at which a pixel misses a one in half of its bits' places: L = K - 1/2.

    Above that its bits say little more than that it is bright.

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
    """Give the intensity of the brightest parts of a scene: all but 0.1 % of it is darker.

    Parameters
    ----------
    data : Bits or array_like of int
        Bits, or an image of counts (H, W) or (H, W, C).
    sensor : Sensor
        What made them; its `max_intensity` does not matter.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    float
        Above 0, in units of intensity; the quantile of the picture smoothed by a Gaussian.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit.

    Examples
    --------
    >>> sensor = Sensor(frames=64)
    >>> round(estimate_brightness(sensor.expose(np.full((32, 32), 0.3), rng=0), sensor), 1)
    0.3
    """
    most = max_measurable_intensity(sensor)
    blur = partial(denoise.gaussian, sigma=_BLUR)
    picture = noniterative(data, sensor.replace(max_intensity=most), denoiser=blur, threads=threads)
    # A dark capture still needs a scale.
    return max(float(np.quantile(picture, BRIGHTNESS_QUANTILE)), 1e-3 * most)


def training_sensor(
    data: Bits | npt.ArrayLike, sensor: Sensor, *, threads: int | None = None
) -> tuple[Sensor, float]:
    """Give the sensor that a network for this very capture is trained for, and the brightness.

    Photographs with intensities in [0, 1], multiplied by the brightness, are then such scenes as
    the capture's.

    Examples
    --------
    >>> seen = Sensor(frames=64).expose(np.full((32, 32), 0.3), rng=0)
    >>> sensor, scale = training_sensor(seen, Sensor(frames=64))
    >>> round(sensor.max_intensity / scale)
    2
    """
    scale = estimate_brightness(data, sensor, threads=threads)
    return sensor.replace(max_intensity=HEADROOM * scale), scale
