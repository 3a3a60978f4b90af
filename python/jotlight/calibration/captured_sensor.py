"""The check that the bits of a calibration are those that it assumes."""

import numpy as np

from jotlight.sensing.bits import Bits
from jotlight.sensing.readings import readings_differ
from jotlight.sensing.sensor import Sensor


def check_captured_sensor(name: str, data: object, threshold: int) -> None:
    """Raise ValueError unless the sensor that bits carry has the threshold of a calibration.

    All bits must have one gain and one threshold, and no read noise. Of other data, and of bits
    without a sensor, nothing is known.

    Examples
    --------
    >>> bits = Sensor(frames=4, threshold=2).expose(np.zeros((8, 8)), rng=0)
    >>> check_captured_sensor("dark", bits, 2)
    >>> check_captured_sensor("dark", bits, 1)
    Traceback (most recent call last):
      ...
    ValueError: dark: expected bits of threshold 1, got bits of threshold 2; state threshold=2 ...
    """
    sensor = data.sensor if isinstance(data, Bits) else None
    if not isinstance(sensor, Sensor):
        return
    if readings_differ(sensor):
        names = [each for each in ("gain", "threshold") if np.ndim(getattr(sensor, each))]
        raise ValueError(
            f"{name}: expected bits of one gain and one threshold, got several values of "
            f"{' and '.join(names)}; capture frames of one exposure and one threshold"
        )
    if sensor.read_noise:
        raise ValueError(
            f"{name}: expected bits without read noise, got {sensor.read_noise:g}, which a "
            "calibration would take for dark counts; state measured dark counts in "
            "Sensor(dark_counts=…) (--dark-counts)"
        )
    if sensor.threshold != threshold:
        raise ValueError(
            f"{name}: expected bits of threshold {threshold}, got bits of threshold "
            f"{sensor.threshold}; state threshold={sensor.threshold} (--threshold "
            f"{sensor.threshold})"
        )
