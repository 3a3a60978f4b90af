"""Checks of arguments that several modules share: numbers, paths, data, and counts."""

import math
import operator
import os
from typing import Any

import numpy as np
import numpy.typing as npt

MAX_THREADS = 1024
"""Largest number of threads that the engine starts."""

MAX_SHOWN = 8
"""Largest number of numbers of an array that a message shows."""

_ADVICE = {
    "Bits": "take one frame, bits[0], or bits.counts()",
    "Readings": "take one frame, readings[0], or readings.sum()",
    "Merged": "take an estimate, such as jotlight.reconstruct(merged), or its arrays, merged.ones "
    "and merged.trials",
    "FilmImage": "take an estimate, such as jotlight.reconstruct(image.data)",
    "Uncertainty": "take one of its maps, such as uncertainty.standard_error",
}
"""What to take in place of data, by the names of their types."""


def shown(value: object) -> str:
    """Return how a message shows a value: an array of many numbers by its type and shape.

    Examples
    --------
    >>> shown("a"), shown(np.zeros((64, 64)))
    ("'a'", 'an array of float64 of shape (64, 64)')
    """
    if isinstance(value, np.ndarray) and value.size > MAX_SHOWN:
        return f"an array of {value.dtype} of shape {value.shape}"
    return repr(value)


def type_of(value: object, array: npt.NDArray[Any]) -> str:
    """Return the type of the numbers of an array, or that of a value that holds no numbers.

    Examples
    --------
    >>> type_of(0.5, np.array(0.5)), type_of(None, np.array(None))
    ('float64', 'NoneType')
    """
    is_other = array.dtype == object and not isinstance(value, np.ndarray)
    return type(value).__name__ if is_other else str(array.dtype)


def whole_number(name: str, value: Any, minimum: int) -> int:
    """Return `value` as an int that is at least `minimum`.

    Raises
    ------
    TypeError, ValueError
        When the value is not an integer, or is a bool, or is below `minimum`.

    Examples
    --------
    >>> whole_number("steps", 3, 1)
    3
    """
    other: Any = None if isinstance(value, bool | np.bool_) else value  # bool has an index, too
    try:
        number = operator.index(other)
    except TypeError:
        raise TypeError(f"{name}: expected a whole number, got {shown(value)}") from None
    if number < minimum:
        raise ValueError(f"{name}: expected at least {minimum}, got {number}")
    return number


def whole_number_in_range(name: str, value: Any, minimum: int, maximum: int) -> int:
    """Return `value` as an int from `minimum` to `maximum`. A whole float such as 4.0 is valid.

    Raises
    ------
    ValueError
        For anything else, text and bool included.

    Examples
    --------
    >>> whole_number_in_range("threshold", 2.0, 1, 65535)
    2
    """
    number = real_number(value)
    if not minimum <= number <= maximum or number != int(number):
        raise ValueError(
            f"{name}: expected a whole number from {minimum} to {maximum}, got {shown(value)}"
        )
    return int(number)


def check_threads(threads: Any) -> None:
    """Raise TypeError or ValueError unless this is a number of threads, or None for all cores.

    Examples
    --------
    >>> check_threads(-1)
    Traceback (most recent call last):
      ...
    ValueError: threads: expected a whole number from 1 to 1024, got -1; leave it out for all cores
    """
    is_whole = isinstance(threads, int | np.integer) and not isinstance(threads, bool)
    if threads is None or (is_whole and 1 <= threads <= MAX_THREADS):
        return
    raise (ValueError if is_whole else TypeError)(
        f"threads: expected a whole number from 1 to {MAX_THREADS}, got {shown(threads)}; leave "
        "it out for all cores"
    )


def positive_number(name: str, value: Any) -> float:
    """Return `value` as a finite float above 0.

    Raises
    ------
    ValueError
        For anything else, text and bool included.

    Examples
    --------
    >>> positive_number("learning_rate", 1e-3)
    0.001
    """
    number = float(real_number(value))
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{name}: expected a finite number above 0, got {shown(value)}")
    return number


def number_in_range(
    name: str, value: Any, minimum: float, maximum: float, advice: str = ""
) -> float:
    """Return `value` as a float from `minimum` to `maximum`. Errors end with the advice.

    Raises
    ------
    ValueError
        For anything else, text and bool included.

    Examples
    --------
    >>> number_in_range("gain", 2, 1e-18, 1e18)
    2.0
    """
    number = float(real_number(value))
    if not minimum <= number <= maximum:
        raise ValueError(
            f"{name}: expected a number from {minimum:g} to {maximum:g}, got {shown(value)}{advice}"
        )
    return number


def real_number(value: Any) -> float:
    """Return `value` if it is a single real number, and NaN otherwise, also for text and bool.

    Examples
    --------
    >>> real_number(2), real_number("2"), real_number([2])
    (2, nan, nan)
    """
    array = np.asarray(value)
    return array.item() if array.ndim == 0 and array.dtype.kind in "iuf" else math.nan


def refuse_masked(
    name: str,
    data: object,
    advice: str = "fill it, and pass its mask to the sensor if there is one",
) -> None:
    """Raise TypeError for a masked array, or a list of such rows: their mask would be ignored."""
    for each in data if isinstance(data, list | tuple) else ():
        refuse_masked(name, each, advice)
    if isinstance(data, np.ma.MaskedArray):
        raise TypeError(f"{name}: expected a plain array, got a masked one; {advice}")


def refuse_data(name: str, data: object) -> None:
    """Raise TypeError for data, or a list of data, whose frames NumPy would turn into an array."""
    for each in data if isinstance(data, list | tuple) else [data]:
        if (advice := _ADVICE.get(type(each).__name__)) is not None:
            raise TypeError(f"{name}: expected an array, got {type(each).__name__}; {advice}")


def require_intensities(name: str, image: npt.NDArray[Any]) -> None:
    """Raise TypeError unless an image holds floats. The message says how to convert it.

    Examples
    --------
    >>> require_intensities("image", np.array([[True]]))
    Traceback (most recent call last):
      ...
    TypeError: image: expected floats in units of intensity, got bool; pass image.astype(float), ...
    """
    if image.dtype.kind == "f":
        return
    advice = ""
    if image.dtype == np.bool_:
        advice = "; pass image.astype(float), which is 1 where the image is True"
    elif image.dtype.kind in "iu":
        advice = (
            ", whose scale is unknown; divide by its white level, such as image / 255.0 for an "
            "8-bit photograph"
        )
    raise TypeError(f"{name}: expected floats in units of intensity, got {image.dtype}{advice}")


def refuse_image_path(name: str, images: object, call: str) -> None:
    """Raise TypeError for a path in place of images, with the call that reads them."""
    if isinstance(images, str | os.PathLike):
        raise TypeError(
            f"{name}: expected an array, got the path {os.fspath(images)!r}; pass {call}"
        )


def as_image(image: npt.ArrayLike, name: str = "image") -> npt.NDArray[Any]:
    """Return intensities of images as float32 or float64. Such arrays are not copied.

    Messages call the images `name`.

    Raises
    ------
    TypeError
        For integers, whose scale is unknown, and for all other types except floats.
    ValueError
        When an intensity is negative or not finite, or there are none.
    """
    refuse_image_path(name, image, "jotlight.read_image(path)")
    array = to_array(name, image)
    require_intensities(name, array)
    if array.ndim < 2 or array.size == 0:
        raise ValueError(
            f"{name}: expected shape (H, W) or (..., H, W), and at least one pixel, got "
            f"{array.shape}"
        )
    # min and max propagate NaN and infinity, and need no temporary array of the image's size.
    low, high = array.min(), array.max()
    if not (np.isfinite(low) and np.isfinite(high)):
        raise ValueError(f"{name}: expected finite intensities, got NaN or infinity")
    if low < 0:
        raise ValueError(f"{name}: expected intensities of 0 or more, got {low}")
    if array.dtype not in (np.float32, np.float64):
        array = array.astype(np.float64 if array.dtype.itemsize > 4 else np.float32)
    return array if array.flags.aligned else array.copy()


def as_counts(data: npt.ArrayLike) -> npt.NDArray[np.int32]:
    """Return counts of pixels, (H, W) or with more axes, as aligned int32 in C order.

    Raises
    ------
    TypeError
        For bool and floats, and for masked arrays.
    ValueError
        For less than two axes or no pixels, and for counts out of range.
    """
    counts = to_array("counts", data)
    if counts.dtype.kind not in "iu" and counts.size:  # an empty list has the type of floats
        advice = (
            "pass frames of bool to jotlight.Bits.from_array(frames, sensor), and cast rounded "
            "floats with astype(int)"
        )
        if counts.dtype == object and counts.ndim >= 2:
            convert = "to_numpy(int)" if hasattr(data, "to_numpy") else "astype(int)"
            advice = f"pass x.{convert} of whole numbers x that are stored as objects"
        raise TypeError(
            f"data: expected jotlight.Bits or an image of counts in whole numbers, got "
            f"{type_of(data, counts)}; {advice}"
        )
    if counts.ndim < 2 or counts.size == 0:
        raise ValueError(
            f"counts: expected shape (H, W) or (..., H, W), and at least one pixel, got "
            f"{counts.shape}"
        )
    # Numbers from 2**31 upward exist only in other types.
    if counts.min() < 0 or (counts.dtype != np.int32 and counts.max() >= 2**31):
        raise ValueError(f"counts: expected 0 to 2**31 - 1, got {counts.min()} to {counts.max()}")
    return np.require(counts, np.int32, ["C", "ALIGNED"])


def to_array(name: str, values: Any) -> npt.NDArray[Any]:
    """Return values as an array. Lists become arrays if their rows have the same length.

    Raises
    ------
    TypeError, ValueError
        For masked arrays, for data such as bits, and when the rows of a list differ in length.
    """
    refuse_masked(name, values)
    refuse_data(name, values)
    try:
        return np.asarray(values)
    except TypeError as error:
        if "BFloat16" not in str(error):
            raise
        text = f"{name}: expected numbers that NumPy knows, got bfloat16; pass tensor.float()"
        raise TypeError(text) from error
    except ValueError as error:
        lengths = _different_lengths(values)
        if lengths is None:
            raise
        raise ValueError(
            f"{name}: expected rows of the same length, got {lengths}; fill up the short rows, or "
            "remove them"
        ) from error


def _different_lengths(values: Any) -> str | None:
    """Return the first two lengths of rows that differ in a nested list, or None."""
    level = [values]
    while level and all(isinstance(each, list | tuple) for each in level):
        lengths = [len(each) for each in level]
        other = next((length for length in lengths if length != lengths[0]), None)
        if other is not None:
            return f"rows of {lengths[0]} and {other}"
        level = [row for each in level for row in each]
    is_mixed = any(isinstance(each, list | tuple) for each in level)
    return "single values beside rows" if is_mixed else None
