"""The checks that the sensor of bits is one that a calibration assumes."""

import numbers

import numpy as np

from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.parameters.reading_groups import readings_differ
from jotlight.sensing.sensor import Sensor


def captured_threshold(threshold: int | None, **captures: object) -> int:
    """Return the threshold of a calibration: the stated one, or that of the sensor of the bits.

    All bits must have one gain and this threshold, and no read noise. Of other data, and of bits
    without a sensor, nothing is known, and the default is 1.

    Raises
    ------
    TypeError
        When a capture is a number, probably that of its frames.
    ValueError
        When the bits of a capture are of another kind.

    Examples
    --------
    >>> bits = jl.Sensor(frames=4, threshold=2).expose(np.zeros((8, 8)), rng=0)
    >>> captured_threshold(None, dark=bits, flat=None)
    2
    >>> captured_threshold(1, dark=bits)
    Traceback (most recent call last):
      ...
    ValueError: dark: expected bits of threshold 1, got bits of threshold 2; state threshold=2 ...
    """
    found = {name: _threshold_of(name, data) for name, data in captures.items()}
    known = {name: value for name, value in found.items() if value is not None}
    stated = next(iter(known.values()), 1) if threshold is None else threshold
    for name, value in known.items():
        if value != stated and threshold is None:
            raise ValueError(
                f"{name}: expected bits of threshold {stated}, as those of {next(iter(known))}, "
                f"got bits of threshold {value}; capture both with one threshold"
            )
        if value != stated:
            raise ValueError(
                f"{name}: expected bits of threshold {stated}, got bits of threshold {value}; "
                f"state threshold={value} (--threshold {value}), or leave it out"
            )
    return stated


def refuse_read_noise(sensor: Sensor) -> None:
    """Raise ValueError for a sensor with read noise, which measured dark counts contain.

    Examples
    --------
    >>> refuse_read_noise(jl.Sensor(read_noise=0.3))
    Traceback (most recent call last):
      ...
    ValueError: read_noise: expected 0 with the dark counts of a calibration, ..., got 0.3; ...
    """
    if sensor.read_noise:
        raise ValueError(
            "read_noise: expected 0 with the dark counts of a calibration, which contain the ones "
            f"that read noise causes, got {sensor.read_noise:g}; state read_noise=0 "
            "(--read-noise 0), or dark counts without read noise, dark_counts=… (--dark-counts)"
        )


def _threshold_of(name: str, data: object) -> int | None:
    """Return the threshold of the sensor that bits carry, or None if nothing is known."""
    if isinstance(data, numbers.Real):
        raise TypeError(
            f"{name}: expected jotlight.Bits or counts (H, W), got the number {data}; for a number "
            f"of frames, pass frames={data}"
        )
    sensor = data.sensor if isinstance(data, Bits) else None
    if not isinstance(sensor, Sensor):
        return None
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
    return int(sensor.threshold)
