"""Functions of the caller as methods: what they receive, and what they must return."""

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits import Bits, check_fits
from jotlight.sensing.merged import Merged
from jotlight.sensing.pixel_counts import Data, GrayImages, PreparedData
from jotlight.sensing.sensor import Sensor

OwnMethod = Callable[..., npt.ArrayLike]
"""A function ``f(data, sensor)`` or ``f(data)`` that returns an image."""

_POSITIONAL = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD
"""Kinds of parameters that take values without names."""


def run_own(
    method: OwnMethod,
    data: PreparedData,
    sensor: Sensor,
    threads: int | None,
    options: dict[str, Any],
) -> npt.NDArray[np.float32]:
    """Return the image of a function of the caller, after checking it.

    The function receives bits that carry the sensor, merged counts, or an array of counts. It
    receives the elements of a list of bits one after the other. It also receives the sensor and
    the number of threads if it has such parameters.

    Raises
    ------
    TypeError, ValueError
        When the data do not fit the sensor, or the result is no image of their size.
    """
    name = getattr(method, "__name__", repr(method))
    if isinstance(data, GrayImages) and not isinstance(data.data, np.ndarray):
        return data.map(lambda image: run_own(method, image, sensor, threads, options))
    checked, expected = _prepare(data, sensor)
    arguments, keywords = arguments_of(method, checked, sensor, threads)
    result = np.asarray(method(*arguments, **{**keywords, **options}))
    if result.dtype.kind not in "biuf":
        raise TypeError(f"method: expected an image of numbers from {name}, got {result.dtype}")
    if result.shape != expected:
        raise ValueError(
            f"method: expected an image of shape {expected} from {name}, got {result.shape}"
        )
    if not np.isfinite(result).all():
        raise ValueError(f"method: expected finite intensities from {name}, got NaN or infinity")
    return result.astype(np.float32, copy=False)


def arguments_of(
    method: OwnMethod, data: Data, sensor: Sensor, threads: int | None
) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """Return the arguments with which a function of the caller is called.

    The sensor is the second argument if the second parameter has no default, or if a parameter is
    named `sensor`. A function without a readable signature receives only the data.

    Examples
    --------
    >>> len(arguments_of(lambda bits, clip=False: bits, 1, 2, None)[0])
    1
    >>> arguments_of(lambda bits, sensor=None: bits, 1, 2, None)
    ((1,), {'sensor': 2})
    """
    try:
        parameters = dict(inspect.signature(method).parameters)
    except (TypeError, ValueError):  # functions in C may have no signature
        return (data,), {}
    if isinstance(method, np.ufunc):
        return (data,), {}
    keywords = {"threads": threads} if "threads" in parameters else {}
    if "sensor" in parameters:
        return (data,), {"sensor": sensor, **keywords}
    positional = [each for each in parameters.values() if each.kind in _POSITIONAL]
    if len(positional) > 1 and positional[1].default is inspect.Parameter.empty:
        return (data, sensor), keywords
    return (data,), keywords


def _prepare(data: PreparedData, sensor: Sensor) -> tuple[Data, tuple[int, ...]]:
    """Return data after checking them, and the shape of the image that they show."""
    if isinstance(data, Merged):
        return data, data.shape
    if isinstance(data, GrayImages):
        counts = data.layout.arrange(np.asarray(data.data))
        return counts, counts.shape
    if not isinstance(data, Bits):
        return data, data.shape
    check_fits(data, sensor)
    _, height, width, *channels = data.shape
    shape = height // sensor.oversampling, width // sensor.oversampling, *channels
    return Bits(data.packed, data.width, sensor, data.provenance), shape
