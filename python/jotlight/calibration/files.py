"""The contents of a file of a calibration, checked before they become one."""

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.calibration.bulk import Bulk
from jotlight.calibration.steadiness import Steadiness
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor
from jotlight.tensors import Tensors

MAPS = {
    "dark_counts": np.float32,
    "efficiency": np.float32,
    "mask": np.bool_,
    "hot": np.bool_,
    "dead": np.bool_,
    "dark_ones": np.int32,
    "flat_ones": np.int32,
    "dark_steadiness": np.float32,
    "flat_steadiness": np.float32,
}
"""The tensors of a file and their types."""

_REQUIRED = {"dark_counts", "mask", "hot", "dead", "dark_ones"}

_STEADINESS = {"dark_steadiness", "flat_steadiness"}
_SCALARS = {
    "dark_frames": (1, 2**31, int),
    "threshold": (1, 2**31, int),
    "hot_threshold": (1, 2**31, int),
    "hot_probability": (0, 1, float),
    "false_positive_rate": (0, 1, float),
    "max_dark": (0, math.inf, float),
    "scale": (0, 1e6, float),
}
_FLAT_SCALARS = {
    "prnu": (0, math.inf, float),
    "prnu_error": (0, math.inf, float),
    "flat_noise": (0, math.inf, float),
}
"""Names, limits, and types of the numbers in a file. Those of a flat capture are optional."""

_MOSAIC = {"pattern", "filters", "transmission", "white_balance"}

_NUMBERS = {*_SCALARS, *_FLAT_SCALARS, *_STEADINESS, "flat_frames", "bulk", "mosaic", "provenance"}
"""Names of all metadata."""


def checked_fields(tensors: Tensors, numbers: Any) -> dict[str, Any]:
    """Return the fields of a calibration from a file, or raise ValueError."""
    _check_tensors(tensors)
    if not isinstance(numbers, dict) or not numbers.keys() <= _NUMBERS:
        raise ValueError("its metadata are not those of a calibration")
    values: dict[str, Any] = dict(numbers)
    for name, limits in _SCALARS.items():
        values[name] = _number(numbers.get(name), name, *limits)
    if any((name in numbers) != ("efficiency" in tensors) for name in _FLAT_SCALARS):
        raise ValueError(f"expected all of efficiency, {', '.join(_FLAT_SCALARS)}, or none")
    for name, limits in (_FLAT_SCALARS | {"flat_frames": (1, 2**31, int)}).items():
        if name in numbers:
            values[name] = _number(numbers[name], name, *limits)
    bulk = _object(numbers.get("bulk"), "bulk", {"frames", "mean", "spread"})
    values["bulk"] = Bulk(
        _number(bulk["frames"], "frames", 1, 2**31, int),
        _number(bulk["mean"], "mean", 0, 1),
        _number(bulk["spread"], "spread", 0, 100),
    )
    for name in _STEADINESS:
        if (name in numbers) != (name in tensors):
            raise ValueError(f"{name}: expected both a map and numbers")
        if name in numbers:
            values[name] = _steadiness(name, numbers[name], tensors[name])
    if "mosaic" in numbers:
        values["mosaic"] = Mosaic.of(_object(numbers["mosaic"], "mosaic", _MOSAIC))
        values["mosaic"].check_size(*tensors["mask"].shape)
    provenance = values.get("provenance", {})
    if not isinstance(provenance, dict) or not provenance.keys() <= {"dark", "flat"}:
        raise ValueError("provenance: expected an object with dark and flat")
    values["provenance"] = {name: Provenance.from_json(part) for name, part in provenance.items()}
    for name in MAPS.keys() - _STEADINESS:
        values[name] = tensors.get(name)
    # The sensor checks the values of its maps.
    Sensor(
        dark_counts=values["dark_counts"],
        efficiency=1.0 if values["efficiency"] is None else values["efficiency"],
        mask=values["mask"],
    )
    return values


def _check_tensors(tensors: Tensors) -> None:
    """Raise ValueError unless the tensors are maps of one shape, with known names and types."""
    if not _REQUIRED <= tensors.keys() <= MAPS.keys():
        raise ValueError(f"expected tensors {', '.join(_REQUIRED)}, got {', '.join(tensors)}")
    shape = tensors["mask"].shape
    for name, tensor in tensors.items():
        if tensor.dtype != MAPS[name] or tensor.shape != shape or tensor.ndim != 2:
            raise ValueError(f"{name}: got {tensor.dtype} of shape {tensor.shape}")


def _steadiness(name: str, content: Any, map_: npt.NDArray[Any]) -> Steadiness:
    names = {field.name for field in dataclasses.fields(Steadiness)} - {"map"}
    values = _object(content, name, names)
    found = {part: _number(values[part], part, -math.inf, math.inf) for part in names}
    return Steadiness(**found, map=map_)


def _object(value: Any, name: str, keys: set[str]) -> dict[str, Any]:
    if not isinstance(value, dict) or value.keys() != keys:
        raise ValueError(f"{name}: expected an object with {', '.join(sorted(keys))}")
    return value


def _number(value: Any, name: str, low: float, high: float, kind: type = float) -> Any:
    if type(value) not in (int, kind) or not low <= value <= high or math.isinf(value):
        raise ValueError(f"{name}: expected a number from {low:g} to {high:g}, got {value!r}")
    return kind(value)
