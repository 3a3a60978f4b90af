"""Numbers and maps: their checks, and their form in the engine."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import MAX_SHOWN, shown, to_array, type_of
from jotlight.sensing.bits.readings import Readings


def flatten(value: Any) -> Any:
    """Return a map as a flat array, without a copy if it is contiguous. Return a number unchanged.

    A map of one pixel that many images share has a stride of 0, and is copied.

    Examples
    --------
    >>> flatten(np.arange(4).reshape(2, 2)), flatten(0.5)
    (array([0, 1, 2, 3]), 0.5)
    """
    return np.ascontiguousarray(value.reshape(-1)) if isinstance(value, np.ndarray) else value


def extent(values: npt.ArrayLike) -> str:
    """Return the smallest and the largest number as a text.

    Examples
    --------
    >>> extent([4, 2.5]), extent(4.0)
    ('2.5 to 4', '4')
    """
    low, high = np.min(values), np.max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def as_doubles(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return numbers as an aligned array of float64 in C order: itself, if it already is one.

    Examples
    --------
    >>> as_doubles([1, 2]).dtype
    dtype('float64')
    """
    # numpy.require takes several microseconds, which iterative methods notice.
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        flags = values.flags
        if flags.c_contiguous and flags.aligned:
            return values
    return np.require(values, np.float64, ["C", "ALIGNED"])


def numbers_from_zero(name: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return real numbers from 0 upward as an aligned array of float64 in C order.

    Raises
    ------
    TypeError
        For masked arrays.
    ValueError
        For values that are not numbers, negative, or not finite, and for rows of different length.

    Examples
    --------
    >>> numbers_from_zero("trials", [2, 0.5]).tolist()
    [2.0, 0.5]
    """
    array = to_array(name, values)
    if array.dtype.kind not in "iuf" or not (np.isfinite(array) & (array >= 0)).all():
        raise ValueError(f"{name}: expected finite numbers, 0 or more, got {_outside(values)}")
    return as_doubles(array)


def _outside(values: npt.ArrayLike) -> str:
    """Return how a message shows values that are not all finite numbers from 0 upward."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.size <= MAX_SHOWN:
        return shown(values)
    outside = array[~(np.isfinite(array) & (array >= 0))]
    return f"{outside[0]:g}" + (f" and {len(outside) - 1} others" if len(outside) > 1 else "")


def numbers_of_ones(ones: npt.ArrayLike | Readings) -> npt.NDArray[np.int32]:
    """Return numbers of ones as aligned int32 in C order.

    Raises
    ------
    TypeError
        For readings of several bits, floats, and masked arrays.
    ValueError
        When a number is not 0 to 2**31 - 1.

    Examples
    --------
    >>> numbers_of_ones([3, 0]).dtype
    dtype('int32')
    """
    if isinstance(ones, Readings):
        raise TypeError(
            "ones: expected numbers of ones, got Readings of several bits; jotlight.merge_readings "
            "turns readings and their sensor into ones and trials"
        )
    array = to_array("ones", ones)
    if array.dtype.kind not in "iub":
        raise TypeError(f"ones: expected whole numbers, got {type_of(ones, array)}")
    if array.size and (array.min() < 0 or array.max() >= 2**31):
        raise ValueError(f"ones: expected 0 to 2**31 - 1, got {array.min()} to {array.max()}")
    return np.require(array, np.int32, ["C", "ALIGNED"])


def number_or_map(
    name: str, array: npt.NDArray[np.float64], shape: tuple[int, ...]
) -> float | npt.NDArray[np.float64]:
    """Return an array of the given shape, or the number in an array without dimensions.

    Raises
    ------
    ValueError
        For another shape.

    Examples
    --------
    >>> number_or_map("trials", np.array(2.0), (3, 4))
    2.0
    """
    if array.ndim == 0:
        return float(array)
    if array.shape != shape:
        raise ValueError(f"{name}: expected a number or shape {shape}, got {array.shape}")
    return array


def checked_trials(
    trials: npt.ArrayLike, ones: npt.NDArray[np.int32]
) -> float | npt.NDArray[np.float64]:
    """Return the numbers of trials behind the counts `ones`: a number or a map of their shape.

    Raises
    ------
    TypeError, ValueError
        When the trials are not real numbers from 0 upward, have another shape, or are below the
        number of ones.

    Examples
    --------
    >>> checked_trials(4, np.array([3, 0], np.int32))
    4.0
    """
    checked = number_or_map("trials", numbers_from_zero("trials", trials), ones.shape)
    if ones.min() < 0:
        raise ValueError(f"ones: expected 0 to the number of trials, got {ones.min()}")
    if (ones > checked).any():
        worst = int(np.argmax(ones - checked))
        index = tuple(int(each) for each in np.unravel_index(worst, ones.shape))
        trials_there = np.broadcast_to(checked, ones.shape)[index]
        raise ValueError(
            f"ones: expected 0 to the number of trials, got {ones[index]} of {trials_there:g} at "
            f"the index {index}"
        )
    return checked


def check_any_valid(valid: npt.ArrayLike) -> None:
    """Raise ValueError unless some pixel has a valid bit, in each image of a stack (N, H, W).

    Examples
    --------
    >>> check_any_valid([[True, False], [False, False]])
    """
    values = np.asarray(valid)
    if not values.any(axis=tuple(range(max(0, values.ndim - 2), values.ndim))).all():
        raise ValueError(
            "trials: expected at least one pixel with a valid bit, got none; the sensor's mask "
            "marks all jots as dead, or all trials are 0"
        )
