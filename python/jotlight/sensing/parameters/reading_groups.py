"""Groups of readings with the same gain and threshold, and sensors that need several groups."""

import dataclasses
from typing import Any, Generic, Protocol, TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.sensing.parameters.reading_checks import Gain, Threshold
from jotlight.sensing.parameters.sensor_like import SensorLike
from jotlight.sensing.parameters.slices import require_slice

S = TypeVar("S", bound="GroupedSensor")


class GroupedSensor(SensorLike, Protocol):
    """The part of :class:`jotlight.Sensor` that groups of readings use."""

    @property
    def gain(self) -> Gain: ...  # noqa: D102
    @property
    def threshold(self) -> Threshold: ...  # noqa: D102
    @property
    def read_noise(self) -> float: ...  # noqa: D102
    @property
    def mask(self) -> npt.NDArray[np.bool_] | None: ...  # noqa: D102


@dataclasses.dataclass(frozen=True)
class ReadingGroup(Generic[S]):
    """The readings of a sensor that have the same gain and the same threshold."""

    frames: npt.NDArray[np.intp]
    """The frames of the group, in ascending order."""
    sensor: S
    """A sensor with these frames, one gain, and one threshold. Its mask also marks the jots with
    other thresholds."""


def frames_differ(sensor: GroupedSensor) -> bool:
    """Return whether the gain or the threshold has a value for each frame."""
    return _is_per_frame(sensor.gain) or _is_per_frame(sensor.threshold)


def _is_per_frame(value: Any) -> TypeGuard[npt.NDArray[Any]]:
    return isinstance(value, np.ndarray) and value.ndim == 1


def readings_differ(sensor: GroupedSensor) -> bool:
    """Return whether the readings of a sensor differ in their gain or their threshold."""
    return isinstance(sensor.gain, np.ndarray) or isinstance(sensor.threshold, np.ndarray)


def group_readings(sensor: S) -> list[ReadingGroup[S]]:
    """Return the groups of readings with the same gain and the same threshold.

    Every reading of a live jot is in one group. The order is that of the gains, and then that of
    the thresholds.
    """
    number, gain, threshold = sensor.frames, sensor.gain, sensor.threshold
    length = number if frames_differ(sensor) else 1
    gains = gain if isinstance(gain, np.ndarray) else np.full(length, gain / number)
    of_frames = np.ones(length) if np.ndim(threshold) == 2 else np.broadcast_to(threshold, length)
    pairs = np.stack([gains, np.asarray(of_frames, np.float64)])
    unique, places = np.unique(pairs, axis=1, return_inverse=True)
    groups: list[ReadingGroup[S]] = []
    for index, (one_gain, one_threshold) in enumerate(unique.T.tolist()):
        frames = np.flatnonzero(np.broadcast_to(places.reshape(-1) == index, number))
        same = {"frames": len(frames), "gain": one_gain * len(frames)}
        if np.ndim(threshold) == 2:
            for value in np.unique(threshold):
                mask = np.asarray(threshold != value)
                mask = mask if sensor.mask is None else mask | sensor.mask
                own = sensor.replace(**same, threshold=int(value), mask=mask)
                groups.append(ReadingGroup(frames, own))
        else:
            own = sensor.replace(**same, threshold=int(one_threshold))
            groups.append(ReadingGroup(frames, own))
    return groups


def select_frames(sensor: S, frames: slice) -> S:
    """Return the sensor of some of the frames, each of which keeps its gain and threshold."""
    require_slice("frames", frames)
    number = len(range(sensor.frames)[frames])
    if not readings_differ(sensor):
        return sensor.replace(frames=number)
    gain, threshold = sensor.gain, sensor.threshold
    return sensor.replace(
        frames=number,
        gain=gain[frames] if isinstance(gain, np.ndarray) else gain * number / sensor.frames,
        threshold=threshold[frames] if _is_per_frame(threshold) else threshold,
    )


def replaced_gain(sensor: GroupedSensor, changes: dict[str, Any]) -> dict[str, Any]:
    """Return changes of a sensor, which include its gain if it has a value for each frame.

    The light of a jot and frame stays as it is, unless the changes contain the gain.

    Raises
    ------
    ValueError
        When the number of frames changes, but not the values for each frame.
    """
    frames = changes.get("frames", sensor.frames)
    for name in ("gain", "threshold"):
        if frames != sensor.frames and name not in changes and _is_per_frame(getattr(sensor, name)):
            raise ValueError(
                f"frames: expected {sensor.frames}, because the sensor has a {name} for each "
                f"frame, got {frames!r}; pass {name} too, or take frames: bits[a:b], "
                "sensor.select_frames(slice(a, b))"
            )
    if "gain" in changes or not isinstance(sensor.gain, np.ndarray):
        return changes
    side = changes.get("oversampling", sensor.oversampling)
    return {**changes, "gain": sensor.gain * (side / sensor.oversampling) ** 2}


def has_plain_bits(sensor: GroupedSensor) -> bool:
    """Return whether readings are bits with one gain and one threshold, without read noise."""
    return not readings_differ(sensor) and sensor.bit_depth == 1 and sensor.read_noise == 0


COUNTS_ADVICE = (
    "pass the data to jotlight.reconstruct or jotlight.uncertainty, which take them with every "
    "method, or to jotlight.mle"
)
"""What to do with readings that a method of counts does not take."""

MOSAIC_ADVICE = "jotlight.reconstruct and jotlight.uncertainty take such readings behind a mosaic"
"""The same for a sensor with a mosaic."""


def require_plain_bits(sensor: GroupedSensor, advice: str = COUNTS_ADVICE) -> None:
    """Raise ValueError unless the readings are bits with one gain and threshold, without noise.

    The sensor must be gray, too.

    Examples
    --------
    >>> require_plain_bits(jl.Sensor(frames=2, bit_depth=4))
    Traceback (most recent call last):
      ...
    ValueError: sensor: expected single bits without noise, got readings of 4 bits; pass ...
    """
    refuse_mosaic(sensor)
    if sensor.bit_depth == 1 and sensor.read_noise == 0:
        refuse_different_readings(sensor, advice)
        return
    depth = f"readings of {sensor.bit_depth} bits" if sensor.bit_depth > 1 else "single bits"
    noise = f" with read noise {sensor.read_noise:g}" if sensor.read_noise else ""
    raise ValueError(f"sensor: expected single bits without noise, got {depth}{noise}; {advice}")


def without_mosaic(sensor: S) -> S:
    """Return a sensor that treats all pixels as gray.

    Examples
    --------
    >>> without_mosaic(jl.Sensor(frames=4, gain=2.0, mosaic="RGGB"))
    Sensor(frames=4, gain=2.0)
    """
    return sensor.replace(mosaic=None, gain=sensor.gain)


def refuse_mosaic(sensor: GroupedSensor) -> None:
    """Raise ValueError when a sensor has a color mosaic.

    Examples
    --------
    >>> refuse_mosaic(jl.Sensor(mosaic="RGGB"))
    Traceback (most recent call last):
      ...
    ValueError: sensor: expected a gray sensor, got one with the mosaic Mosaic('RGGB'); ...
    """
    if sensor.mosaic is not None:
        raise ValueError(
            f"sensor: expected a gray sensor, got one with the mosaic {sensor.mosaic!r}; "
            "jotlight.reconstruct estimates colors, by every method; sensor.replace(mosaic=None) "
            "treats all pixels as gray"
        )


def refuse_different_readings(sensor: GroupedSensor, advice: str = COUNTS_ADVICE) -> None:
    """Raise ValueError when the readings of a sensor differ in their gain or their threshold.

    Examples
    --------
    >>> refuse_different_readings(jl.Sensor(frames=2, gain=[1.0, 8.0]))
    Traceback (most recent call last):
      ...
    ValueError: sensor: expected one gain and one threshold for all readings, got ...
    """
    names = [
        name for name in ("gain", "threshold") if isinstance(getattr(sensor, name), np.ndarray)
    ]
    if names:
        each = " and ".join(
            f"a {name} for each {'frame' if np.ndim(getattr(sensor, name)) == 1 else 'jot'}"
            for name in names
        )
        raise ValueError(
            f"sensor: expected one gain and one threshold for all readings, got {each}; {advice}"
        )
