"""The file format of networks: arrays in a `.safetensors` file, everything else as its metadata."""

import json
import operator
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.networks.architectures import QUALITIES
from jotlight.networks.inference.engine_backed import EngineBacked
from jotlight.networks.layer import Layer
from jotlight.networks.planes import color_planes, film_planes
from jotlight.paths import as_path, as_tensors_path
from jotlight.sensing.sensor import Sensor
from jotlight.tensors import read_tensors, write_tensors
from jotlight.underflow import underflows_to_0

_FORMAT = "jotlight network"
_VERSION = "3"

_KINDS = {
    0: ("a network of gray images", "Network"),
    film_planes.PLANES: ("a film network", "FilmNetwork"),
    color_planes.PLANES: ("a color network", "ColorNetwork"),
}
"""The kinds of networks by their number of planes, and the classes that read them."""

_UNKNOWN = "a network of another kind", ""

_Network = TypeVar("_Network")


def write_network(
    path: str | os.PathLike[str],
    network: EngineBacked,
) -> None:
    """Write the parts of a network to a file atomically.

    Raises
    ------
    TypeError
        When JSON cannot hold the history.
    ValueError
        When the name of the file does not end in `.safetensors`.
    """
    path = as_tensors_path(path, 'network.save("mine.safetensors")')
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
        "planes": json.dumps(network.planes),
        "history": json.dumps(network.history),
    }
    write_tensors(path, tensors, metadata)


@underflows_to_0
def _compact(array: npt.NDArray[np.float32]) -> npt.NDArray[np.floating]:
    """Return an array in float16 if it holds the same numbers."""
    with np.errstate(over="ignore"):
        half = array.astype(np.float16)
    return half if np.array_equal(half, array) else array


def _expand(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an array in float32 if it is in float16."""
    return array.astype(np.float32) if array.dtype == np.float16 else array


def count_planes(path: str | os.PathLike[str]) -> int:
    """Return the number of planes that the network in a file reads, or 0 if it reads counts.

    The errors are those of :func:`read_network`.
    """
    path = _network_file(path)
    _, metadata = read_tensors(path, _FORMAT, _VERSION)
    return _planes_of(path, metadata)


def read_network(
    path: str | os.PathLike[str], make: Callable[..., _Network], *, planes: int
) -> _Network:
    """Return `make(layers, sensor, history, trials_range=..., rotations=...)` for a file's parts.

    Raises
    ------
    OSError
        When the file does not exist.
    ValueError
        When it is not a network file, `make` rejects its parts, or the network reads another number
        of planes.
    """
    path = _network_file(path)
    tensors, metadata = read_tensors(path, _FORMAT, _VERSION)
    received = _planes_of(path, metadata)
    if received != planes:
        (expected, _), (got, name) = (_KINDS.get(each, _UNKNOWN) for each in (planes, received))
        hint = f", which jotlight.{name}.load reads" if name else ""
        raise ValueError(f"{path}: expected {expected}, got {got}{hint}")
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
        rotations, history = json.loads(metadata["rotations"]), json.loads(metadata["history"])
        return make(layers, sensor, history, trials_range=trials_range, rotations=rotations)
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise ValueError(f"{path}: damaged network file: {error}") from error


def refuse_onnx(path: Path) -> None:
    """Raise ValueError for the file of an ONNX model.

    Examples
    --------
    >>> refuse_onnx(Path("own.safetensors"))
    """
    if path.suffix.lower() == ".onnx" and path.is_file():
        raise ValueError(
            f"{path}: this is an ONNX model, which runs in ONNX Runtime: "
            f"onnxruntime.InferenceSession({path.name!r}); jotlight reads the .safetensors file of "
            "the network, which network.save writes"
        )


def _network_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file that exists and is no ONNX model."""
    path = as_path(path, 'jotlight.Network.load("mine.safetensors")')
    if not path.is_file():
        is_size = str(path) in QUALITIES
        raise FileNotFoundError(
            f"there is no network file {path}"
            + (f"; quality={path} (--quality {path}) selects the pretrained network" * is_size)
        )
    refuse_onnx(path)
    return path


def _planes_of(path: Path, metadata: Mapping[str, str]) -> int:
    """Return the number of planes, which is 0 for networks of counts."""
    try:
        return operator.index(json.loads(metadata["planes"]))
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: damaged network file: {error}") from error
