"""The brightness of a scene, estimated from its bits, and a sensor to train a network for."""

from functools import partial

import numpy as np

import jotlight._engine as engine
from jotlight.estimators.denoise import gaussian
from jotlight.estimators.noniterative import noniterative
from jotlight.parameter_names import check_choice
from jotlight.sensing.data.pixel_counts import Data, GrayImages, PreparedData
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor, require_trainable

_BLUR = 3.0
"""The standard deviation, in pixels, of the Gaussian that removes noise before the quantile."""

BRIGHTNESS_QUANTILE = 0.999
"""The fraction of the pixels that are darker than the brightness of the scene."""

HEADROOM = 2.0
"""The ratio of a network's maximum intensity to the brightness, which highlights exceed."""


UNITS = {
    "intensity": "intensity",
    "photons": "detected photons per pixel and frame",
    "photons-per-second": "detected photons per pixel and second",
}
"""Units of estimates, with the text that a file states."""


def detected_photons(sensor: Sensor) -> float:
    """Return η α/T: the photons that a pixel of intensity 1 detects per frame.

    η is that of the median jot, so that no single jot affects the result.

    Examples
    --------
    >>> efficiency = np.array([[0.5, 0.5, 1.0]])
    >>> detected_photons(jl.Sensor(frames=10, gain=20.0, efficiency=efficiency))
    1.0
    """
    return reference_jot(sensor).efficiency * sensor.gain / sensor.frames


def unit_scale(sensor: Sensor, units: str, data: PreparedData | None = None) -> float:
    """Return the factor from intensities to other units.

    Parameters
    ----------
    sensor : Sensor
        The sensor of the data. Photons per second need its `exposure_time`.
    units : {"intensity", "photons", "photons-per-second"}
        Intensities; or the photons that a pixel with the efficiency of the median jot detects per
        frame, or per second.
    data : Bits, Readings, Merged, GrayImages, or ndarray, optional
        The data of the estimate. The trials of equivalent counts get a share of the light of a
        frame. Default: data of whole frames.

    Raises
    ------
    ValueError
        For unknown units, where the exposure time is unknown, or where frames have different gains.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=10, gain=20.0, exposure_time=1e-5)
    >>> unit_scale(sensor, "photons"), round(unit_scale(sensor, "photons-per-second"))
    (2.0, 200000)
    >>> unit_scale(sensor, "photons", jl.Merged([[3]], 40.0, sensor, light_share=0.25))
    8.0
    """
    check_choice("units", units, UNITS)
    if units == "intensity":
        return 1.0
    share = None if np.ndim(sensor.gain) else _light_share(data)
    if share is None:
        raise ValueError(
            f'units: expected "intensity", because the frames have different gains, got {units!r}; '
            "multiply the result by the photons that a pixel of intensity 1 detects"
        )
    photons = detected_photons(sensor) / share
    if units == "photons":
        return photons
    if sensor.exposure_time is None:
        raise ValueError(
            "units: photons per second need the exposure time of a frame in seconds; state it with "
            "Sensor(exposure_time=1e-5) (--exposure-time 1e-5), for example"
        )
    return photons / sensor.exposure_time


def _light_share(data: PreparedData | None) -> float | None:
    """Return the light of a trial as a share of that of a frame, or None if gains differ."""
    each = data.data if isinstance(data, GrayImages) else [data]
    shares = {one.light_share if isinstance(one, Merged) else 1.0 for one in each}
    return shares.pop() if len(shares) == 1 else None


def max_measurable_intensity(sensor: Sensor) -> float:
    """Return the intensity at which a pixel is expected to show L = K - 1/2 ones.

    The bits of brighter pixels are nearly all 1 and hardly distinguish their intensities.

    Examples
    --------
    >>> round(max_measurable_intensity(jl.Sensor(frames=16)), 3)  # -log(1/32)
    3.466
    """
    response = sensor.pixel_response()
    efficiency, dark = reference_jot(sensor)
    rate = engine.inverse_detection_probability(response.threshold, 1 - 0.5 / sensor.trials)
    return max(rate - dark, 1e-12) / (efficiency * response.light_per_intensity)


def estimate_brightness(
    data: Data, sensor: Sensor, *, channel_axis: int | None = None, threads: int | None = None
) -> float:
    """Return the brightness of a scene: the intensity below which 99.9 % of its pixels are.

    Parameters
    ----------
    data : Bits, Merged, list of them, or array_like of int
        Bits, merged counts, or counts (..., H, W).
    sensor : Sensor
        The sensor that recorded the data. Its `max_intensity` has no effect.
    channel_axis : int, optional
        The axis of counts that holds color channels. Default: none.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    float
        The brightness in units of intensity, above 0. It is a quantile of a smoothed estimate.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=64)
    >>> round(estimate_brightness(sensor.expose(np.full((32, 32), 0.3), rng=0), sensor), 1)
    0.3
    """
    max_intensity = max_measurable_intensity(sensor)
    estimate = noniterative(
        data,
        sensor.replace(max_intensity=max_intensity),
        channel_axis=channel_axis,
        denoiser=partial(gaussian, sigma=_BLUR),
        threads=threads,
    )
    # The brightness is a scale, so it must not be 0 even for a capture in darkness.
    return max(float(np.quantile(estimate, BRIGHTNESS_QUANTILE)), 1e-3 * max_intensity)


def training_sensor(
    data: Data, sensor: Sensor, *, channel_axis: int | None = None, threads: int | None = None
) -> tuple[Sensor, float]:
    """Return the sensor to train a network for this capture with, and the brightness.

    Photographs with intensities in [0, 1] become suitable training scenes when they are multiplied
    by the brightness.

    Parameters
    ----------
    data, sensor, channel_axis, threads
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
        When data and sensor do not fit together, or no network can be trained for the sensor.

    Examples
    --------
    >>> bits = jl.Sensor(frames=64).expose(np.full((32, 32), 0.3), rng=0)
    >>> sensor, brightness = training_sensor(bits, jl.Sensor(frames=64))
    >>> round(sensor.max_intensity / brightness)
    2
    """
    require_trainable(sensor)
    brightness = estimate_brightness(data, sensor, channel_axis=channel_axis, threads=threads)
    return sensor.replace(max_intensity=HEADROOM * brightness), brightness
