"""Checks of the parameters of readings: their gain, threshold, number of bits, and read noise."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.arrays import frozen
from jotlight.checks import number_in_range, shown, to_array, whole_number_in_range
from jotlight.errors import warn
from jotlight.sensing.parameters.maps import LIMITS, MAX_THRESHOLD, checked_threshold_map

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
        # So the gain of each frame alone is in the range, too.
        return number_in_range("gain", gain, frames * LIMITS[0], LIMITS[1])
    _check_frames("gain", values, frames, "a number")
    values = values.astype(np.float64)
    low, high = values.min(), values.max()
    if not LIMITS[0] <= low <= high <= LIMITS[1] or not values.sum() <= LIMITS[1]:
        raise ValueError(
            f"gain: expected a number from {LIMITS[0]:g} to {LIMITS[1]:g} for each frame, got "
            f"{low:g} to {high:g}"
        )
    return float(low * frames) if low == high else frozen(values)


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
    return int(low) if low == high else frozen(values.astype(np.int64))


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
        each = f"each of the {frames} frames" if frames > 1 else "the only frame"
        number_of_values = len(values) if values.ndim == 1 and values.size else frames
        raise ValueError(
            f"{name}: expected {number}, or one for {each}{some}, got {values.dtype} of shape "
            f"{values.shape}; state the number of frames too, as in "
            f"Sensor(frames={number_of_values}, {name}=[…])"
        )
