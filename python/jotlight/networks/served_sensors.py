"""The check that a network serves the data of a sensor."""

import math

from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor


def check_served(
    own: Sensor, sensor: Sensor, trials_range: tuple[int, int] | None, *, tied: bool
) -> None:
    """Raise ValueError when a network does not serve a sensor. The message says how they differ.

    Parameters
    ----------
    own : Sensor
        Sensor of the network.
    sensor : Sensor
        Sensor of the data.
    trials_range : (int, int), optional
        Smallest and largest K of a K-conditioned network. None: the network is for one K.
    tied : bool
        Whether the network serves every combination of jots and frames with the same K.
    """
    trials = sensor.trials
    if trials_range is not None and trials < trials_range[0]:
        raise ValueError(
            f"sensor: the network is for {trials_range[0]} trials per pixel or more, got {trials}"
        )
    if not tied and (own.oversampling, own.frames) != (sensor.oversampling, sensor.frames):
        raise ValueError(
            f"sensor: the network is for {own.frames} frames of {own.oversampling} x "
            f"{own.oversampling} jots per pixel, got {sensor.frames} frames of "
            f"{sensor.oversampling} x {sensor.oversampling}"
        )
    if own.kernel != sensor.kernel:
        raise ValueError(f"sensor: the network is for the {own.kernel} kernel, got {sensor.kernel}")
    if trials_range is not None:
        return
    pairs = zip(_response_to_light(own), _response_to_light(sensor), strict=True)
    if own.trials != trials or not all(math.isclose(a, b, rel_tol=1e-9) for a, b in pairs):
        raise ValueError(
            "sensor: the network needs data with its own trials per pixel, threshold, "
            f"efficiency * gain / bits and max_intensity: it is for {own!r}, got {sensor!r}"
        )


def _response_to_light(sensor: Sensor) -> tuple[int, float, float]:
    """Return q, the detections per jot and frame at intensity 1, and S."""
    threshold, light, max_intensity = sensor.pixel_response()
    return threshold, reference_jot(sensor)[0] * light, max_intensity
