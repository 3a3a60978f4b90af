"""Sensors as text and as HTML, and sensors from the metadata of files."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.notebook import card, normalize
from jotlight.sensing.parameters.sensor_like import SensorLike

AnySensor = TypeVar("AnySensor", bound=SensorLike)


def repr_of(sensor: SensorLike, defaults: Mapping[str, object]) -> str:
    """Return the parameters of a sensor in the form of a call, without those of default values.

    Maps are shown by their size, and values for each frame by their number and range.
    """
    parts = []
    for name, default in defaults.items():
        value = getattr(sensor, name)
        if isinstance(value, np.ndarray) and value.ndim == 1:
            parts.append(f"{name}=<{_values(value)}>")
        elif isinstance(value, np.ndarray):
            parts.append(f"{name}=<{value.shape[0]} x {value.shape[1]} map>")
        elif value != (sensor.trials if name == "gain" else default):
            parts.append(f"{name}={value!r}")
    return f"{type(sensor).__name__}({', '.join(parts)})"


def html_of(sensor: SensorLike) -> str:
    """Return HTML that describes a sensor, for notebooks."""
    facts: dict[str, object] = {"trials per pixel": sensor.trials, **sensor.scalars()}
    for name, value in facts.items():
        if isinstance(value, list):
            facts[name] = _values(np.array(value))
    if sensor.mosaic is not None:
        facts["mosaic"] = repr(sensor.mosaic)
    maps, image = sensor.maps(), None
    for name, values in maps.items():
        size = " x ".join(map(str, values.shape))
        facts[name] = f"map of {size} jots, mean {float(values.mean()):.3g}"
    if maps:
        first, values = next(iter(maps.items()))
        facts["image"], image = f"map of {first}".replace("_", " "), normalize(values)
    shown = {name.replace("_", " "): value for name, value in facts.items()}
    return card(type(sensor).__name__, shown, image)


def _values(values: npt.NDArray[Any]) -> str:
    return f"{len(values)} values, {values.min():g} to {values.max():g}"


def sensor_of_parts(
    make: Callable[..., AnySensor],
    names: Sequence[str],
    scalars: Any,
    maps: Mapping[str, npt.NDArray[Any]],
) -> AnySensor:
    """Return a sensor with parameters from files, whose names must be among `names`.

    Raises
    ------
    ValueError
        When the parts do not describe a sensor.
    """
    if not isinstance(scalars, dict):
        raise ValueError(
            f"sensor: expected an object with named parameters, got {type(scalars).__name__}"
        )
    if unknown := sorted(map(str, set(scalars) - set(names))):
        raise ValueError(f"sensor: unknown parameters {', '.join(unknown)}")
    try:
        return make(**{**scalars, **maps})
    except TypeError as error:
        raise ValueError(f"sensor: {error}") from error
