"""Functions of the caller as methods: their import, what they receive, and what they return."""

import functools
import hashlib
import importlib
import inspect
import re
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.arrays import read_only
from jotlight.checks import refuse_masked
from jotlight.errors import warn
from jotlight.networks.loading import AnyNetwork
from jotlight.parameter_names import nearest_names
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import check_fits
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.pixel_counts import Data, GrayImages, PreparedData
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

OwnMethod = Callable[..., npt.ArrayLike]
"""A function ``f(data, sensor)`` or ``f(data)`` that returns an image."""

_POSITIONAL = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD
"""Kinds of parameters that take values without names."""


def import_method(reference: str) -> OwnMethod:
    """Return the function that ``MODULE:FUNCTION`` names, such as ``mine:denoise``.

    The modules of the current folder are found first. If the function raises an exception later, it
    becomes a ValueError that names the line.

    Parameters
    ----------
    reference : str
        Module and function, separated by a colon. The module may lie in a package, ``a.b:f``.

    Raises
    ------
    ImportError
        When the module is missing, or its import fails.
    TypeError, ValueError
        When the reference does not name a function.

    Examples
    --------
    >>> import_method("builtins:sum")([1, 2])
    3
    """
    name, _, attribute = reference.partition(":")
    if not re.fullmatch(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*", reference):
        raise ValueError(
            f"method: expected MODULE:FUNCTION, such as mine:denoise for the function denoise in "
            f"mine.py, got {reference!r}"
        )
    module = _import_module(reference, str(Path.cwd()))
    if not hasattr(module, attribute):
        close = nearest_names(attribute, dir(module))
        advice = f"; did you mean {name}:{close[0]}?" if close else ""
        raise ValueError(f"method: the module {name} has no function {attribute}{advice}")
    function = getattr(module, attribute)
    if not callable(function):
        raise TypeError(
            f"method: expected a function, but {reference} is of type {type(function).__name__}"
        )

    @functools.wraps(function)
    def run(*arguments: Any, **keywords: Any) -> npt.ArrayLike:
        try:
            result: npt.ArrayLike = function(*arguments, **keywords)
        except (Exception, SystemExit) as error:
            _raise_subclass_of_exit(error)
            raise ValueError(f"method: {reference} raised {_describe(error, module)}") from error
        return result

    return run


def checksum_of_module(reference: str) -> str:
    """Return the SHA-256 of the module of ``MODULE:FUNCTION``, or its name if it has no file."""
    module = inspect.getmodule(inspect.unwrap(import_method(reference)))
    path = getattr(module, "__file__", None)
    if path is None:
        return reference
    with open(path, "rb") as file:  # noqa: PTH123
        return hashlib.file_digest(file, "sha256").hexdigest()


def _import_module(reference: str, folder: str) -> ModuleType:
    """Return the module of ``MODULE:FUNCTION``."""
    name, _, attribute = reference.partition(":")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not (name == error.name or name.startswith(f"{error.name}.")):
            raise ImportError(f"method: the import of {name} failed: {error}") from error
        own = name.removesuffix(".py")
        advice = "" if own == name else f"; did you mean {own}:{attribute}?"
        raise ModuleNotFoundError(
            f"method: there is no module {name}, neither {name.replace('.', '/')}.py in {folder} "
            f"nor installed{advice}"
        ) from error
    except (Exception, SystemExit) as error:
        _raise_subclass_of_exit(error)
        raise ImportError(f"method: the import of {name} failed: {_first_line(error)}") from error


def _raise_subclass_of_exit(error: BaseException) -> None:
    """Raise an exit again unless it is a plain SystemExit, for example that of a signal."""
    if isinstance(error, SystemExit) and type(error) is not SystemExit:
        raise error


def _first_line(error: BaseException) -> str:
    """Return the type of an exception, and the first line of its message."""
    lines = str(error).splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


def _describe(error: BaseException, module: ModuleType) -> str:
    """Return an exception and the last line of a module that led to it."""
    text = _first_line(error)
    frames = traceback.extract_tb(error.__traceback__)
    lines = [each.lineno for each in frames if each.filename == getattr(module, "__file__", None)]
    return f"{text} ({module.__file__}, line {lines[-1]})" if lines else text


def run_own(
    method: OwnMethod,
    data: PreparedData,
    sensor: Sensor,
    threads: int | None,
    options: dict[str, Any],
) -> npt.NDArray[np.float32]:
    """Return the image of a function of the caller, after checking it.

    The function receives bits that carry the sensor, merged counts, or counts (H, W). It is called
    for each image of a stack and each channel of counts. It also receives the sensor and the number
    of threads if it has such parameters.

    Raises
    ------
    TypeError, ValueError
        When the data do not fit the sensor, or the result is not an image of their size.
    """
    name = _name(method)
    if isinstance(data, GrayImages):
        each = [run_own(method, image, sensor, threads, options) for image in data.data]
        return data.layout.arrange(np.stack(each))
    checked, expected = _prepare(data, sensor)
    arguments, keywords = arguments_of(method, checked, sensor, threads)
    keywords |= options
    _check_parameters(method, arguments, keywords)
    try:
        returned = method(*arguments, **keywords)
        result = np.asarray(returned)
    except (TypeError, AttributeError) as error:
        error.add_note(_about(checked, name))
        raise
    refuse_masked(f"the result of {name}", returned, "return array.filled(0) or another value")
    if result.dtype.kind not in "biuf":
        kind = "None; does it return its image?" if returned is None else str(result.dtype)
        raise TypeError(f"method: expected an image of numbers from {name}, got {kind}")
    if result.shape != expected:
        raise ValueError(
            f"method: expected an image of shape {expected} from {name}, got {result.shape}"
        )
    if not np.isfinite(result).all():
        raise ValueError(f"method: expected finite intensities from {name}, got NaN or infinity")
    if result.dtype.kind in "iu" and result.max() > sensor.max_intensity:
        warn(
            f"method: {name} returns whole numbers up to {result.max()}, which look like counts; "
            f"intensities are at most max_intensity={sensor.max_intensity:g}, and the fraction of "
            "ones is counts / sensor.trials"
        )
    return result.astype(np.float32, copy=False)


def noting_planes(method: object, estimate: Callable[..., Any]) -> Callable[..., Any]:
    """Return `estimate` of planes of a mosaic, whose errors state what a function received.

    Parameters
    ----------
    method : callable, network, str, or None
        The method behind `estimate`. Only for a function of the caller, errors get a note.
    estimate : callable
        A function of the planes, and of others.
    """
    if not callable(method) or isinstance(method, AnyNetwork):
        return estimate

    def run(planes: Any, *arguments: Any, **keywords: Any) -> Any:
        try:
            return estimate(planes, *arguments, **keywords)
        except Exception as error:
            error.add_note(
                f"{_name(method)} receives the counts (h, w) of each plane of the mosaic, the "
                "pixels behind one filter of its pattern, and returns an image of the same shape; "
                "they are Merged where the trials or the readings differ; a function that returns "
                "the colors can be called by itself: jotlight.metrics.psnr(function(bits), image)"
            )
            raise

    return run


def _name(method: object) -> str:
    """Return the name of a function for messages."""
    return str(getattr(method, "__name__", repr(method)))


def _check_parameters(
    method: OwnMethod, arguments: tuple[Any, ...], keywords: dict[str, Any]
) -> None:
    """Raise TypeError unless a function takes the arguments with which it will be called."""
    try:
        signature = inspect.signature(method)
    except (TypeError, ValueError):  # functions in C may have no signature
        return
    try:
        signature.bind(*arguments, **keywords)
    except TypeError as error:
        raise TypeError(
            "method: expected a function f(data, sensor) or f(data), with the options as further "
            f"parameters, got {_name(method)}{signature}: {error}"
        ) from None


def _about(data: Data, name: str) -> str:
    """Return what a function of the caller received, for one that expects something else."""
    if isinstance(data, np.ndarray):
        return f"{name} received counts, an array {data.shape}, which has no methods of Bits"
    if isinstance(data, Merged):
        return f"{name} received Merged; merged.ones is an array of counts"
    if isinstance(data, Readings):
        return f"{name} received Readings; readings.to_array() is an array of frames"
    return f"{name} received Bits; bits.counts() is an array of counts, bits.to_array() one of bits"


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


def _prepare(
    data: Bits | Readings | Merged | npt.NDArray[np.int32], sensor: Sensor
) -> tuple[Data, tuple[int, ...]]:
    """Return data after checking them, and the shape of the image that they show.

    A function of the caller cannot change the data themselves, which other methods also receive.
    """
    if isinstance(data, Merged):
        return data, data.shape
    if isinstance(data, np.ndarray):
        return data.copy(), data.shape
    bit_depth = data.bit_depth if isinstance(data, Readings) else 1
    check_fits(data.shape, sensor, bit_depth=bit_depth)
    _, height, width, *channels = data.shape
    shape = height // sensor.oversampling, width // sensor.oversampling, *channels
    if isinstance(data, Readings):
        return Readings(_unchangeable(data.frames), sensor, data.provenance), shape
    return data.replace(packed=_unchangeable(data.packed), sensor=sensor), shape


def _unchangeable(frames: npt.NDArray[Any] | Frames) -> npt.NDArray[Any] | Frames:
    """Return frames in files, or a read-only view of an array."""
    return frames if isinstance(frames, Frames) else read_only(frames)
