"""Checks of bits: their values, the order and number of their axes, and that they fit a sensor."""

import os
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import refuse_masked, to_array, type_of, whole_number
from jotlight.errors import warn
from jotlight.layout import MAX_CHANNELS
from jotlight.sensing.parameters.sensor_like import SensorLike

MOVE_FRAMES = "move their axis to the front: np.moveaxis(array, 2, 0)"
"""What to do with frames (H, W, T)."""

_MOVE_FRAMES_LAST = (
    "move their axis to the end: permute(array, [2 3 1]) in MATLAB, or np.moveaxis(array, 0, 2)"
)
"""What to do with frames (T, H, W) in a format of frames (H, W, T)."""

_MIN_SIDE = 64
"""Minimum size of two axes at which a short third axis looks like that of the frames."""

_MIN_RATIO = 4
"""Minimum ratio of these sizes and the size of the third axis."""

_MIN_EQUAL, _MAX_ASPECT = 32, 8
"""If two axes are equal and have at least this size, and the third axis is more than this many
times as long, the third axis is probably that of the frames.

As many frames as a frame has rows are rare, and so are jots in such long strips. Sensors with 8
times as many columns as rows exist.
"""


_MIN_ROWS, _MAX_FRAME_ASPECT = 8, 2
"""Smallest number of rows that may be frames, and largest aspect of the frames that would follow,
in formats that store frames as (H, W, T)."""


def warn_about_axes(name: str, shape: tuple[int, ...], *, frames_last: bool = False) -> None:
    """Warn about frames whose axes were probably stored in another order.

    Parameters
    ----------
    name : str
        What is named in the message.
    shape : tuple of int
        The shape as it was read, (T, H, W) or (T, H, W, C).
    frames_last : bool
        Whether the format stores frames as (H, W, T), so that they may have been stored as
        (T, H, W), and not the reverse.

    Examples
    --------
    >>> warn_about_axes("bits", (16, 64, 64))  # no warning
    """
    frames, height, width = shape[:3]
    number, *sides = (height, width, frames) if frames_last else (width, frames, height)
    side = min(sides)
    is_short = side >= _MIN_SIDE and side >= _MIN_RATIO * number
    if frames_last:
        # Sensors with few rows exist, also with a single one.
        is_short &= number >= _MIN_ROWS and max(sides) <= _MAX_FRAME_ASPECT * side
    is_long = sides[0] == sides[1] >= _MIN_EQUAL and number > _MAX_ASPECT * side
    if is_short or is_long:
        warn(
            f"{name}: read as {frames} frames of {height} x {width} jots; if these are {number} "
            f"frames of {sides[0]} x {sides[1]} jots, "
            f"{_MOVE_FRAMES_LAST if frames_last else MOVE_FRAMES}"
        )


def refuse_many_channels(name: str, shape: tuple[int, ...]) -> None:
    """Raise ValueError for frames (T, H, W, C) with more channels than a capture may have.

    Examples
    --------
    >>> refuse_many_channels("a.npy", (32, 1, 96, 104))
    Traceback (most recent call last):
      ...
    ValueError: a.npy: expected shape (T, H, W, C) with at most 4 channels, got (32, 1, 96, 104); \
drop the axis of length 1, as array[:, 0] does
    """
    if len(shape) != 4 or shape[3] <= MAX_CHANNELS:
        return
    singles = [axis for axis, length in enumerate(shape[:2]) if length == 1]
    kind, build = ("Readings",) * 2 if name == "readings" else ("Bits", "Bits.from_array")
    advice = (
        f"for a stack (N, T, H, W), pass a list of {kind} to methods: "
        f"[{build}(frames, sensor) for frames in stack]"
    )
    if singles:
        advice = f"drop the axis of length 1, as array[{'0' if 0 in singles else ':, 0'}] does"
    raise ValueError(
        f"{name}: expected shape (T, H, W, C) with at most {MAX_CHANNELS} channels, got {shape}; "
        f"{advice}"
    )


def as_frames(name: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an array of frames (T, H, W) or (T, H, W, C), where (H, W) is a single frame.

    Raises
    ------
    ValueError
        When the array has another shape, or no value.

    Examples
    --------
    >>> as_frames("bits", np.zeros((4, 5))).shape
    (1, 4, 5)
    """
    frames = values[None] if values.ndim == 2 else values
    if frames.ndim not in (3, 4) or frames.size == 0:
        raise ValueError(
            f"{name}: expected shape (T, H, W), (H, W), or (T, H, W, C), without a dimension of 0, "
            f"got {frames.shape}"
        )
    refuse_many_channels(name, frames.shape)
    return frames


def zeros_and_ones(array: npt.ArrayLike) -> npt.NDArray[Any]:
    """Return unpacked bits as an array (T, H, W) or (T, H, W, C) of bool, or of 0 and 1.

    Raises
    ------
    TypeError, ValueError
        When the array has another type or shape, or holds other values.

    Examples
    --------
    >>> zeros_and_ones([[0, 1]]).shape
    (1, 1, 2)
    """
    refuse_masked("bits", array)
    values = to_array("bits", array)
    if values.dtype.kind not in "biu":
        kind = type_of(array, values)
        advice = "; pass array == 1 for floats" if values.dtype.kind == "f" else ""
        if isinstance(array, str | os.PathLike):
            advice = "; jotlight.open(path) reads a capture from a file"
        raise TypeError(f"bits: expected bool or whole numbers 0 and 1, got {kind}{advice}")
    values = as_frames("bits", values)
    if values.dtype != np.bool_ and (values.min() < 0 or values.max() > 1):
        low, high = values.min(), values.max()
        is_black_and_white = low == 0 and ((values == 0) | (values == high)).all()
        advice = (
            f"pass array == {high} for black and white"
            if is_black_and_white
            else "methods take an image of counts as it is"
        )
        raise ValueError(f"bits: expected 0 and 1 only, got {low} to {high}; {advice}")
    return values


def refuse_frames(data: object) -> None:
    """Raise TypeError for an array of bool in place of bits or counts."""
    if isinstance(data, np.ndarray) and data.dtype == np.bool_:
        raise TypeError(
            "data: expected jotlight.Bits or counts, got an array of bool; pass "
            "jotlight.Bits.from_array(frames, sensor)"
        )


def check_fits(shape: tuple[int, ...], sensor: SensorLike, *, bit_depth: int = 1) -> None:
    """Raise TypeError or ValueError unless readings of this shape and bit depth fit the sensor."""
    if not hasattr(sensor, "bit_depth"):
        raise TypeError(
            f"sensor: expected a jotlight.Sensor, such as Sensor(frames={shape[0]}), got {sensor!r}"
        )
    if sensor.bit_depth != bit_depth:
        own = f"readings of {sensor.bit_depth} bits" if sensor.bit_depth > 1 else "single bits"
        other = "single bits" if bit_depth == 1 else f"readings of {bit_depth} bits"
        advice = f"sensor.replace(bit_depth={bit_depth}) is a sensor with {other}"
        if bit_depth == 1:
            advice = f"jotlight.Readings(array, sensor) are readings of several bits, and {advice}"
        raise ValueError(f"data: expected {own}, as the sensor states, got {other}; {advice}")
    frames, height, width = shape[:3]
    if frames != sensor.frames:
        some = f"bits[:{sensor.frames}] (--frame-range 0:{sensor.frames}), or "
        last = f"if the frames are the last axis, {MOVE_FRAMES}; otherwise "
        raise ValueError(
            f"bits: expected the sensor's {sensor.frames} frames, got {frames}; "
            f"{last if sensor.frames == width > 1 else ''}take "
            f"{some if sensor.frames < frames else ''}"
            f"sensor.replace(frames={frames}) (--frames {frames})"
        )
    checked_oversampling(sensor.oversampling, (height, width))
    sensor.check_map_shapes(height, width)


def checked_oversampling(oversampling: object, jots: tuple[int, int], name: str = "bits") -> int:
    """Return K̂ as an int that divides the rows and columns of jots of frames called `name`.

    Raises
    ------
    TypeError, ValueError
        When K̂ is not a whole number of at least 1, or does not divide them.

    Examples
    --------
    >>> checked_oversampling(2, (4, 6))
    2
    """
    side = whole_number("oversampling", oversampling, 1)
    if jots[0] % side or jots[1] % side:
        raise ValueError(
            f"{name}: expected rows and columns of jots that are multiples of the oversampling "
            f"{side}, got {jots[0]} x {jots[1]}"
        )
    return side
