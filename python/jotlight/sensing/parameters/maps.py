"""Checks of the sensor parameters that may be maps over the jots."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.arrays import frozen
from jotlight.checks import number_in_range, real_number, to_array
from jotlight.errors import percent_advice

LIMITS = 1e-18, 1e18
"""Range of a sensor's gain and largest intensity, and of its other numbers where they are not 0.

float32 holds the product and the ratio of any two such numbers.
"""

_MIN_PERCENTAGE = 0.02
"""An efficiency of at least 100 times this value is taken for a percentage."""

MAX_THRESHOLD = 65535
"""Largest threshold."""

MAPS = ("dark_counts", "efficiency", "mask", "threshold")
"""The parameters of a sensor that may have a value for each jot."""

_TITLES = {
    "dark_counts": "dark counts",
    "efficiency": "efficiency",
    "mask": "dead jots",
    "threshold": "thresholds",
}
"""What each map contains, for messages."""


def checked_maps(
    dark_counts: npt.ArrayLike,
    efficiency: npt.ArrayLike,
    mask: npt.ArrayLike | None,
    threshold: object = None,
) -> dict[str, Any]:
    """Return the checked parameters by name: numbers, read-only maps, and None for no mask.

    `threshold` is already checked. It matters only if it is a map.

    Raises
    ------
    ValueError
        When a value is out of range, an array is not a map, or two maps have different shapes.
    """
    checked = {
        "dark_counts": _checked_dark_counts(dark_counts),
        "efficiency": _checked_efficiency(efficiency),
        "mask": _checked_mask(mask),
    }
    everything = {**checked, "threshold": threshold}
    maps = [
        (name, map_)
        for name, map_ in everything.items()
        if isinstance(map_, np.ndarray) and map_.ndim == 2
    ]
    for name, map_ in maps[1:]:
        first, expected = maps[0][0], maps[0][1].shape
        if map_.shape != expected:
            raise ValueError(
                f"{name}: expected the shape of the map of {_TITLES[first]} {expected}, "
                f"got {map_.shape}"
            )
    return checked


def _range_of(values: npt.NDArray[Any]) -> str:
    """Return the smallest and the largest number of an array for messages, or nan."""
    if values.size == 0:
        return f"shape {values.shape}"
    low, high = f"{values.min():g}", f"{values.max():g}"
    return low if low == high else f"{low} to {high}"


def _checked_dark_counts(dark_counts: npt.ArrayLike) -> float | npt.NDArray[np.float32]:
    dark = to_array("dark_counts", dark_counts)
    if dark.dtype.kind not in "iuf" or dark.ndim not in (0, 2):
        raise ValueError(
            "dark_counts: expected a number, or a map of numbers with one per jot, "
            f"got {dark.dtype} of {dark.ndim} dimensions"
        )
    if dark.ndim == 2:
        # A sensor stores float32, so numbers that overflow fail the check below.
        with np.errstate(over="ignore"):
            dark = dark.astype(np.float32)
    if dark.size == 0 or not (dark.min() >= 0 and dark.max() <= LIMITS[1]):
        raise ValueError(
            f"dark_counts: expected numbers from 0 to {LIMITS[1]:g}, got {_range_of(dark)}"
        )
    return float(dark) if dark.ndim == 0 else frozen(dark, np.float32)


def _checked_efficiency(efficiency: npt.ArrayLike) -> float | npt.NDArray[np.float32]:
    values = to_array("efficiency", efficiency)
    if values.ndim == 0:
        advice = percent_advice(real_number(efficiency), _MIN_PERCENTAGE)
        return number_in_range("efficiency", efficiency, LIMITS[0], 1, advice)
    if values.dtype.kind not in "iuf" or values.ndim != 2:
        raise ValueError(
            "efficiency: expected a number, or a map of numbers with one per jot, "
            f"got {values.dtype} of {values.ndim} dimensions"
        )
    values = values.astype(np.float32)
    if values.size == 0 or not (values >= np.float32(LIMITS[0])).all() or values.max() > 1:
        raise ValueError(
            f"efficiency: expected numbers from {LIMITS[0]:g} to 1, got {_range_of(values)}; "
            "divide efficiencies relative to the mean by their maximum, and multiply gain by it; "
            "mark jots that detect nothing in the mask"
        )
    return frozen(values, np.float32)


def _checked_mask(mask: npt.ArrayLike | None) -> npt.NDArray[np.bool_] | None:
    if mask is None:
        return None
    array = to_array("mask", mask)
    if array.dtype != np.bool_ or array.ndim != 2:
        raise ValueError(
            "mask: expected a 2-D array of bool with True for a dead jot, "
            f"got {array.dtype} of {array.ndim} dimensions"
        )
    return frozen(array, np.bool_)


def checked_threshold_map(values: npt.NDArray[Any]) -> int | npt.NDArray[np.uint16]:
    """Return a map of thresholds, or the number if all jots have the same.

    Raises
    ------
    ValueError
        When a value is not a whole number, or is out of range.

    Examples
    --------
    >>> checked_threshold_map(np.array([[1, 2]])).dtype, checked_threshold_map(np.array([[2.0]]))
    (dtype('uint16'), 2)
    """
    is_numeric = values.dtype.kind in "iuf" and values.size > 0
    if (
        not is_numeric
        or not (values.min() >= 1 and values.max() <= MAX_THRESHOLD)
        or (values.dtype.kind == "f" and (values != np.floor(values)).any())
    ):
        got = f"{values.min():g} to {values.max():g}" if is_numeric else values.dtype
        raise ValueError(
            f"threshold: expected whole numbers from 1 to {MAX_THRESHOLD} in a map of the jots, "
            f"got {got}; mark jots that never report 1 in the mask"
        )
    low = int(values.min())
    return low if low == values.max() else frozen(values, np.uint16)


def pixel_means(
    value: float | npt.NDArray[np.floating], mask: npt.NDArray[np.bool_] | None, oversampling: int
) -> tuple[float | npt.NDArray[np.float64], bool]:
    """Return the mean over the live jots of each pixel, and whether those of any pixel differ.

    A number stands for all jots, so it is the mean.

    Examples
    --------
    >>> pixel_means(np.float32([[1, 3], [1, 3]]), None, 2)
    (array([[2.]]), True)
    """
    if not isinstance(value, np.ndarray):
        return value, False
    height, width = (size // oversampling for size in value.shape)
    blocks = value.astype(np.float64).reshape(height, oversampling, width, oversampling)
    valid = np.ones(blocks.shape, bool)
    if mask is not None:
        valid = ~mask.reshape(blocks.shape)
    live_jots = np.maximum(valid.sum(axis=(1, 3)), 1)
    mean = np.where(valid, blocks, 0).sum(axis=(1, 3)) / live_jots
    # The value of a dead pixel is never used, but it must pass the checks of the range.
    mean = np.where(valid.any(axis=(1, 3)), mean, blocks.mean(axis=(1, 3)))
    differs = valid & (blocks != mean[:, None, :, None].astype(np.float32))
    return np.ascontiguousarray(mean), bool(differs.any())


def mean_dark_counts(
    value: float | npt.NDArray[np.float32],
    mask: npt.NDArray[np.bool_] | None,
    oversampling: int,
    threshold: int,
) -> tuple[float | npt.NDArray[np.float64], bool]:
    """Return the dark counts of a typical jot of each pixel, and whether those of any pixel differ.

    With threshold 1 and these dark counts in all jots, a pixel of jots of equal efficiency has as
    many ones on average at any light. For other thresholds, they are the mean.

    Examples
    --------
    >>> pixel = np.float32([[0.0, 2.0]] * 2)
    >>> mean_dark_counts(pixel, None, 2, 1)[0].round(4)  # half of the jots have exp(-2) zeros
    array([[0.5662]])
    """
    mean, differs = pixel_means(value, mask, oversampling)
    if threshold != 1 or not differs:
        return mean, differs

    def average(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.asarray(pixel_means(values, mask, oversampling)[0])

    return dark_counts_of_mean(np.asarray(value, np.float64), average), differs


def dark_counts_of_mean(
    dark_counts: npt.NDArray[np.float64],
    mean: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]],
) -> npt.NDArray[np.float64]:
    """Return the dark counts of a jot of threshold 1 with as many ones as the mean of other jots.

    Parameters
    ----------
    dark_counts : ndarray
        Those of the jots.
    mean : callable
        A function that returns the means of a map of the jots.

    Examples
    --------
    >>> dark_counts_of_mean(np.array([0.0, 2.0]), lambda jots: jots.mean(keepdims=True)).round(4)
    array([0.5662])
    """
    return np.asarray(-np.log(np.maximum(mean(np.exp(-dark_counts)), np.finfo(np.float64).tiny)))


def stack_maps(values: list[Any], size: tuple[int, ...]) -> Any:
    """Return the number that all images have, or the maps of all, (N, H, W).

    Examples
    --------
    >>> stack_maps([1.0, 1.0], (1, 2)), stack_maps([1.0, 2.0], (1, 2)).tolist()
    (1.0, [[[1.0, 1.0]], [[2.0, 2.0]]])
    """
    if not any(isinstance(value, np.ndarray) for value in values) and len(set(values)) == 1:
        return values[0]
    return np.stack([np.broadcast_to(value, size) for value in values])


def constant_or_map(
    value: float | npt.NDArray[np.float64],
) -> float | npt.NDArray[np.float64]:
    """Return a map, or its number if all pixels have the same, because methods are then faster."""
    low = float(np.min(value))
    return low if low == np.max(value) else value
