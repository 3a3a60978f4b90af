"""Readings that differ: gains and thresholds with a value for each frame, and groups of frames."""

import dataclasses
import math
from typing import Any, Generic, Protocol, TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.checks import number_in_range, shown, to_array, whole_number_in_range
from jotlight.errors import counted, warn
from jotlight.sensing.maps import LIMITS, MAX_THRESHOLD, checked_threshold_map

Gain = float | npt.NDArray[np.float64]
"""α: a number, or the photons on a pixel of intensity 1 in each frame, (T,)."""

Threshold = int | npt.NDArray[np.int64] | npt.NDArray[np.uint16]
"""q: a number, one for each frame (T,), or a map with one for each jot (H·K̂, W·K̂)."""

MAX_BIT_DEPTH = 16
"""Maximum number of bits of a reading."""

MIN_READ_NOISE, MAX_READ_NOISE = 1e-3, 100.0
"""Limits of the standard deviation of read noise above 0, in photons. Less changes no reading."""

AMBIGUOUS_NOISE = 0.5
"""Read noise at which a third of the readings are not the number of photons."""

S = TypeVar("S", bound="GroupedSensor")


class GroupedSensor(Protocol):
    """The part of :class:`jotlight.Sensor` that groups of readings use."""

    @property
    def frames(self) -> int: ...  # noqa: D102
    @property
    def gain(self) -> Gain: ...  # noqa: D102
    @property
    def threshold(self) -> Threshold: ...  # noqa: D102
    @property
    def oversampling(self) -> int: ...  # noqa: D102
    @property
    def bit_depth(self) -> int: ...  # noqa: D102
    @property
    def read_noise(self) -> float: ...  # noqa: D102
    @property
    def mask(self) -> npt.NDArray[np.bool_] | None: ...  # noqa: D102
    @property
    def mosaic(self) -> Any: ...  # noqa: D102
    def replace(self: S, **changes: Any) -> S: ...  # noqa: D102


@dataclasses.dataclass(frozen=True)
class ReadingGroup(Generic[S]):
    """The readings of a sensor that have the same gain and the same threshold."""

    frames: npt.NDArray[np.intp]
    """The frames of the group, in ascending order."""
    sensor: S
    """A sensor with these frames, one gain, and one threshold. Its mask also marks the jots with
    other thresholds."""


def checked_gain(gain: npt.ArrayLike, frames: int) -> Gain:
    """Return a gain as a number, or as a read-only array with one value for each frame.

    Equal values become the number that is their sum.

    Raises
    ------
    ValueError
        When a value is out of range, or the values do not match the frames.

    Examples
    --------
    >>> checked_gain([1.0, 8.0], 2).tolist(), checked_gain([2.0, 2.0], 2)
    ([1.0, 8.0], 4.0)
    """
    values = to_array("gain", gain)
    if values.ndim == 0:
        return number_in_range("gain", gain, *LIMITS)
    _check_frames("gain", values, frames, "a number")
    values = values.astype(np.float64)
    low, high = values.min(), values.max()
    if not LIMITS[0] <= low <= high <= LIMITS[1] or not values.sum() <= LIMITS[1]:
        raise ValueError(
            f"gain: expected a number from {LIMITS[0]:g} to {LIMITS[1]:g} for each frame, got "
            f"{low:g} to {high:g}"
        )
    return float(low * frames) if low == high else _read_only(values)


def checked_threshold(threshold: npt.ArrayLike, frames: int) -> Threshold:
    """Return a threshold as a number, or as a read-only array over the frames or the jots.

    Equal values become one number.

    Raises
    ------
    ValueError
        When a value is out of range, or the array has another shape.

    Examples
    --------
    >>> checked_threshold([1, 4], 2).tolist(), checked_threshold([[3, 3]], 2)
    ([1, 4], 3)
    """
    values = to_array("threshold", threshold)
    if values.ndim == 0:
        return whole_number_in_range("threshold", threshold, 1, MAX_THRESHOLD)
    if values.ndim == 2:
        return checked_threshold_map(values)
    _check_frames("threshold", values, frames, f"a whole number from 1 to {MAX_THRESHOLD}")
    low, high = values.min(), values.max()
    if not 1 <= low <= high <= MAX_THRESHOLD or (values != np.floor(values)).any():
        raise ValueError(
            f"threshold: expected whole numbers from 1 to {MAX_THRESHOLD}, got {low:g} to {high:g}"
        )
    return int(low) if low == high else _read_only(values.astype(np.int64))


def checked_response(bit_depth: object, read_noise: object, threshold: Threshold) -> dict[str, Any]:
    """Return the bits of a reading and the read noise by name.

    Raises
    ------
    ValueError
        When a value is out of range, or a reading of several bits has a threshold.

    Warns
    -----
    JotlightWarning
        When the read noise hides how many photons a jot has seen.

    Examples
    --------
    >>> checked_response(4, 0.3, 1)
    {'bit_depth': 4, 'read_noise': 0.3}
    """
    depth = whole_number_in_range("bit_depth", bit_depth, 1, MAX_BIT_DEPTH)
    noise = number_in_range("read_noise", read_noise, 0, MAX_READ_NOISE)
    if 0 < noise < MIN_READ_NOISE:
        raise ValueError(
            f"read_noise: expected 0, or {MIN_READ_NOISE:g} photons or more, got {noise:g}, which "
            "changes no reading; pass 0"
        )
    if depth > 1 and (isinstance(threshold, np.ndarray) or threshold != 1):
        raise ValueError(
            f"threshold: expected 1, because readings of {depth} bits state the number of photons, "
            f"got {shown(threshold)}; a threshold is for readings of one bit, bit_depth=1"
        )
    if noise >= AMBIGUOUS_NOISE:
        wrong = math.erfc(0.5 / noise / math.sqrt(2))
        warn(
            f"read_noise: {noise:g} photons change {wrong:.0%} of the readings, so a reading "
            "does not tell a number of photons from the next one, nor a dark jot from one with "
            "dark counts; estimates need many readings, and an exact value of the read noise "
            f"and of the dark counts; photons can be counted below {AMBIGUOUS_NOISE:g}"
        )
    return {"bit_depth": depth, "read_noise": noise}


def _check_frames(name: str, values: npt.NDArray[Any], frames: int, number: str) -> None:
    if values.dtype.kind not in "iuf" or values.shape != (frames,):
        some = ", or a map of the jots" if name == "threshold" else ""
        raise ValueError(
            f"{name}: expected {number}, or one for each of the "
            f"{counted(frames, 'frame')}{some}, got {values.dtype} of shape {values.shape}; state "
            f"the number of frames too, as in Sensor(frames={max(values.shape[0], 2)}, {name}=[…])"
        )


def _read_only(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    copy = np.array(values)
    copy.flags.writeable = False
    return copy


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
    if not isinstance(frames, slice):
        raise TypeError(f"frames: expected a slice, such as slice(0, 16), got {shown(frames)}")
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
    >>> from jotlight.sensing.sensor import Sensor
    >>> require_plain_bits(Sensor(frames=2, bit_depth=4))
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
    >>> from jotlight.sensing.sensor import Sensor
    >>> without_mosaic(Sensor(frames=4, gain=2.0, mosaic="RGGB"))
    Sensor(frames=4, gain=2.0)
    """
    return sensor.replace(mosaic=None, gain=sensor.gain)


def refuse_mosaic(sensor: GroupedSensor) -> None:
    """Raise ValueError when a sensor has a color mosaic.

    Examples
    --------
    >>> from jotlight.sensing.sensor import Sensor
    >>> refuse_mosaic(Sensor(mosaic="RGGB"))
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
    >>> from jotlight.sensing.sensor import Sensor
    >>> refuse_different_readings(Sensor(frames=2, gain=[1.0, 8.0]))
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
