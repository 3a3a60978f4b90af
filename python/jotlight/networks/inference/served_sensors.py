"""The check that a network serves the data of a sensor."""

import math

from jotlight.errors import counted
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.sensor import Sensor, require_any_sensor, require_sensor


def check_served(
    own: Sensor, sensor: Sensor, trials_range: tuple[int, int] | None, *, tied: bool
) -> None:
    """Raise ValueError when a network does not serve a sensor. The message says how they differ.

    Anything but a sensor is a TypeError.

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
    require_any_sensor(sensor)
    trials = sensor.trials
    if trials_range is not None and trials < trials_range[0]:
        raise ValueError(
            f"sensor: the network is for {counted(trials_range[0], 'trial')} per pixel or more, "
            f"got {trials}"
        )
    if not tied and (own.oversampling, own.frames) != (sensor.oversampling, sensor.frames):
        raise ValueError(
            f"sensor: the network is for {counted(own.frames, 'frame')} of {own.oversampling} x "
            f"{own.oversampling} jots per pixel, got "
            f"{counted(sensor.frames, 'frame')} of {sensor.oversampling} x {sensor.oversampling}"
        )
    # The engine deconvolves the estimates of K-conditioned networks.
    if own.kernel != sensor.kernel and trials_range is None:
        raise ValueError(f"sensor: the network is for the {own.kernel} kernel, got {sensor.kernel}")
    if trials_range is not None:
        return
    pairs = zip(_response_to_light(own), _response_to_light(sensor), strict=True)
    if own.trials != trials or not all(math.isclose(a, b, rel_tol=1e-9) for a, b in pairs):
        raise ValueError(
            "sensor: the network needs data with its own trials per pixel, threshold, "
            f"efficiency * gain / bits and max_intensity: it is for {own!r}, got {sensor!r}; "
            "for this sensor, use jotlight.pretrained(sensor) (--quality)"
        )


def choose_sensor(
    sensor: Sensor | None,
    own: Sensor,
    trials_range: tuple[int, int] | None,
    *,
    tied: bool,
) -> Sensor:
    """Return the sensor of data whose pixels are all alike, after checks.

    Parameters
    ----------
    sensor : Sensor, optional
        Sensor that a caller states.
    own, trials_range, tied
        Properties of the network, as for :func:`check_served`. Its own sensor is the last choice,
        but a K-conditioned network has none that would fit.

    Raises
    ------
    ValueError
        When there is no sensor, when its readings are not plain bits, when the network does not
        serve it, or when it has maps.

    Examples
    --------
    >>> choose_sensor(None, jl.Sensor(frames=16), None, tied=True)
    Sensor(frames=16)
    """
    if sensor is None:
        if trials_range is not None:
            raise ValueError(
                "sensor: expected the sensor of the data, because this network serves every "
                "number of trials per pixel, got none"
            )
        sensor = own
    require_sensor(sensor)
    check_served(own, sensor, trials_range, tied=tied)
    if own.kernel != sensor.kernel:
        raise ValueError(
            f"sensor: expected the {own.kernel} kernel, got {sensor.kernel}; the engine serves it "
            "(jotlight.Network.reconstruct)"
        )
    if sensor.maps():
        raise ValueError(
            f"sensor: expected one without maps of its jots, got {sensor!r}; the engine takes it "
            "(jotlight.Network.reconstruct), or use sensor.without_maps()"
        )
    expected, received = tuple(reference_jot(own)), tuple(reference_jot(sensor))
    if not tied and received != expected:
        raise ValueError(
            f"sensor: expected the network's efficiency and dark counts, {expected}, got "
            f"{received}; a tied network takes others"
        )
    return sensor


def _response_to_light(sensor: Sensor) -> tuple[int, float, float]:
    """Return q, the detections per jot and frame at intensity 1, and S."""
    response = sensor.pixel_response()
    light = reference_jot(sensor).efficiency * response.light_per_intensity
    return response.threshold, light, response.max_intensity
