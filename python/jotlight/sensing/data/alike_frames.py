"""Checks that all frames of a sensor show a scene alike, or that their exposures repeat."""

from typing import Any

import numpy as np

from jotlight.sensing.parameters.reading_groups import (
    GroupedSensor,
    S,
    frames_differ,
    readings_differ,
    require_plain_bits,
    without_mosaic,
)

_ADVICE = "jotlight.reconstruct makes one image of all frames"


def find_cycle(sensor: GroupedSensor) -> int | None:
    """Return the number of frames after which gains and thresholds repeat, 1 for one exposure.

    Return None if exposures do not repeat at least once.
    """
    if not frames_differ(sensor):
        return 1
    frames = sensor.frames
    per_frame = [each for each in _exposures(sensor) if each.ndim < 2]
    exposures = np.stack([np.broadcast_to(each, frames) for each in per_frame])
    kinds = np.unique(exposures, axis=1, return_inverse=True)[1].reshape(-1).tolist()
    cycle = frames - _border(kinds)
    return cycle if 2 * cycle <= frames else None


def _border(values: list[int]) -> int:
    """Return the length of the longest end of a list that is also its beginning, but not all of it.

    It is the last value of the prefix function of D. Knuth, J. Morris and V. Pratt (SIAM Journal on
    Computing, 1977), in a time that is proportional to the length.

    Examples
    --------
    >>> _border([1, 2, 3, 1, 2])
    2
    """
    lengths, length = [0], 0
    for value in values[1:]:
        while length and value != values[length]:
            length = lengths[length - 1]
        length += value == values[length]
        lengths.append(length)
    return lengths[-1]


def exposure_cycle(sensor: GroupedSensor) -> int:
    """Return the number of frames after which gains and thresholds repeat, as :func:`find_cycle`.

    Raises
    ------
    ValueError
        When exposures do not repeat at least once.

    Examples
    --------
    >>> exposure_cycle(jl.Sensor(frames=8, gain=[1.0, 4.0] * 4))
    2
    >>> exposure_cycle(jl.Sensor(frames=4, bit_depth=3, read_noise=0.2))
    1
    >>> exposure_cycle(jl.Sensor(frames=4, gain=[8.0, 8.0, 1.0, 1.0]))
    Traceback (most recent call last):
      ...
    ValueError: sensor: expected exposures that repeat ... threshold, such as bits[:2] (--frame-r...
    """
    if (cycle := find_cycle(sensor)) is not None:
        return cycle
    raise ValueError(
        "sensor: expected exposures that repeat in cycles, such as short, long, short, long, so "
        f"that each part of a scene is seen alike at all times, got {sensor.frames} frames without "
        f"a repetition; {_ADVICE}{_first_frames(sensor)}"
    )


def check_cycles(cycle: int, window: int, step: int | None) -> None:
    """Raise ValueError unless a window and a step of a film are whole cycles of exposures.

    Examples
    --------
    >>> check_cycles(3, 12, 6)
    """
    for name, value in (("window", window), ("step", step)):
        if value is not None and value % cycle:
            raise ValueError(
                f"{name}: expected a multiple of {cycle}, because the exposures repeat every "
                f"{cycle} frames, got {value}"
            )


def repeat_exposures(sensor: S, frames: int) -> S:
    """Return the sensor of another number of frames, whose exposures repeat as before.

    Examples
    --------
    >>> repeat_exposures(jl.Sensor(frames=4, gain=[1.0, 3.0] * 2), 6).gain.tolist()
    [1.0, 3.0, 1.0, 3.0, 1.0, 3.0]
    """
    if not readings_differ(sensor):
        return sensor.replace(frames=frames)
    changes: dict[str, Any] = {
        name: np.resize(getattr(sensor, name), frames)
        for name in ("gain", "threshold")
        if np.ndim(getattr(sensor, name)) == 1
    }
    # One number for all frames is that of all their photons.
    changes.setdefault("gain", sensor.gain * frames / sensor.frames)
    return sensor.replace(frames=frames, **changes)


def require_alike_frames(sensor: GroupedSensor) -> None:
    """Raise ValueError unless readings are single bits of one gain and threshold, without noise.

    The sensor may have a mosaic. For a bracket, the message names the frames of its first part.

    Examples
    --------
    >>> require_alike_frames(jl.Sensor(frames=4, mosaic="RGGB"))
    >>> require_alike_frames(jl.Sensor(frames=4, gain=[8.0, 8.0, 1.0, 1.0]))
    Traceback (most recent call last):
      ...
    ValueError: sensor: expected one gain ... threshold, such as bits[:2] (--frame-range 0:2)
    """
    require_plain_bits(without_mosaic(sensor), _ADVICE + _first_frames(sensor))


def _exposures(sensor: GroupedSensor) -> list[np.ndarray]:
    return [np.asarray(each) for each in (sensor.gain, sensor.threshold)]


def _first_frames(sensor: GroupedSensor) -> str:
    """Return advice to take the first frames with the same exposure, or to take one exposure."""
    advice = "; motion, films, and the viewer take frames of one gain and threshold"
    per_frame = [each for each in _exposures(sensor) if each.ndim == 1]
    # Parts of a capture with a map of thresholds have the map, too.
    if not per_frame or np.ndim(sensor.threshold) == 2:
        return advice
    differ = np.any([each != each[0] for each in per_frame], axis=0)
    first = int(np.argmax(differ))
    return f"{advice}, such as bits[:{first}] (--frame-range 0:{first})"
