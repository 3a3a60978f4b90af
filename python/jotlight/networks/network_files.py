"""The file format of networks: arrays in a `.safetensors` file, everything else as its metadata."""

import json
import operator
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.networks.architectures import QUALITIES
from jotlight.networks.layer import Layer
from jotlight.sensing.sensor import Sensor
from jotlight.tensors import read_tensors, write_tensors

_FORMAT = "jotlight network"
_VERSION = "3"

_Network = TypeVar("_Network")


class WritableNetwork(Protocol):
    """The parts of a network that a file holds."""

    layers: tuple[Layer, ...]
    sensor: Sensor
    rotations: int
    history: dict[str, Any]

    @property
    def trials_range(self) -> tuple[int, int] | None:
        """Smallest and largest K of a K-conditioned network."""


def write_network(
    path: str | os.PathLike[str],
    network: WritableNetwork,
) -> None:
    """Write the parts of a network to a file atomically.

    Raises
    ------
    TypeError
        When JSON cannot hold the history.
    """
    tensors: dict[str, npt.NDArray[Any]] = {}
    for index, layer in enumerate(network.layers):
        tensors[f"layers.{index}.filters"] = _compact(layer.filters)
        if layer.coefficients is not None:
            tensors[f"layers.{index}.coefficients"] = _compact(layer.coefficients)
    for name, map_ in network.sensor.maps().items():
        tensors[f"sensor.{name}"] = np.ascontiguousarray(map_)
    metadata = {
        "format": _FORMAT,
        "version": _VERSION,
        "layers": json.dumps([layer.metadata() for layer in network.layers]),
        "sensor": json.dumps(network.sensor.scalars()),
        "trials_range": json.dumps(network.trials_range),
        "rotations": json.dumps(network.rotations),
        "history": json.dumps(network.history),
    }
    write_tensors(path, tensors, metadata)


def _compact(array: npt.NDArray[np.float32]) -> npt.NDArray[np.floating]:
    """Return an array in float16 if it holds the same numbers."""
    with np.errstate(over="ignore"):
        half = array.astype(np.float16)
    return half if np.array_equal(half, array) else array


def _expand(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an array in float32 if it is in float16."""
    return array.astype(np.float32) if array.dtype == np.float16 else array


def is_color_network(path: str | os.PathLike[str]) -> bool:
    """Return whether a network file holds a color network, whose last layer has several channels.

    The errors are those of :func:`read_network`.
    """
    return read_network(path, lambda layers, *_, **__: bool(layers[-1].channels > 1))


def read_network(
    path: str | os.PathLike[str], make: Callable[..., _Network], *, is_color: bool | None = None
) -> _Network:
    """Return `make(layers, sensor, history, trials_range=..., rotations=...)` for a file's parts.

    Raises
    ------
    OSError
        When the file does not exist.
    ValueError
        When it is not a network file, `make` rejects its parts, or it is a color network but
        `is_color` is False, or the other way around. None allows both.
    """
    path = Path(path)
    if not path.is_file():
        is_size = str(path) in QUALITIES
        raise FileNotFoundError(
            f"there is no network file {path}"
            + (f"; quality={path} (--quality {path}) selects the shipped network" * is_size)
        )
    tensors, metadata = read_tensors(path, _FORMAT, _VERSION)
    try:
        layers = [
            Layer(
                _expand(tensors[f"layers.{index}.filters"]),
                _expand(tensors[f"layers.{index}.coefficients"]) if "start" in fields else None,
                **fields,
            )
            for index, fields in enumerate(json.loads(metadata["layers"]))
        ]
        maps = {
            name.removeprefix("sensor."): tensor
            for name, tensor in tensors.items()
            if name.startswith("sensor.")
        }
        sensor = Sensor.from_parts(json.loads(metadata["sensor"]), maps)
        trials_range = json.loads(metadata["trials_range"])
        if trials_range is not None:
            low, high = map(operator.index, trials_range)
            trials_range = low, high
        options = {"trials_range": trials_range}
        # The files of most shipped networks were written before this number existed.
        options["rotations"] = json.loads(metadata.get("rotations", "1"))
        is_other = bool(layers) and (layers[-1].channels > 1) == (is_color is False)
        if is_color is None or not is_other:
            return make(layers, sensor, json.loads(metadata["history"]), **options)
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise ValueError(f"{path}: damaged network file: {error}") from error
    gray, color = "a network of gray images", "a color network"
    expected, got = (color, gray) if is_color else (gray, color)
    name = "Network" if is_color else "ColorNetwork"
    raise ValueError(f"{path}: expected {expected}, got {got}, which jotlight.{name}.load reads")
