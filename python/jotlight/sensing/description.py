"""Sensors as text and as HTML."""

from collections.abc import Mapping

import numpy as np

from jotlight.notebook import card
from jotlight.sensing.sensor_like import SensorLike


def repr_of(sensor: SensorLike, defaults: Mapping[str, object]) -> str:
    """Return the call that makes a sensor, without parameters that have their defaults.

    Maps are shown by their size.
    """
    parts = []
    for name, default in defaults.items():
        value = getattr(sensor, name)
        if isinstance(value, np.ndarray):
            parts.append(f"{name}=<{value.shape[0]} x {value.shape[1]} map>")
        elif value != (sensor.trials if name == "gain" else default):
            parts.append(f"{name}={value!r}")
    return f"Sensor({', '.join(parts)})"


def html_of(sensor: SensorLike) -> str:
    """Return HTML that describes a sensor, for notebooks."""
    facts: dict[str, object] = {"trials per pixel": sensor.trials, **sensor.scalars()}
    for name, values in sensor.maps().items():
        size = " x ".join(map(str, values.shape))
        facts[name] = f"map of {size} jots, mean {float(values.mean()):.3g}"
    return card("Sensor", {name.replace("_", " "): value for name, value in facts.items()})
