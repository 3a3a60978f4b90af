"""The values of options that describe a sensor: mosaics, maps, and values of frames."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.formats.images.maps import is_map, read_map
from jotlight.sensing.parameters.mosaic import Mosaic

_REPEATS = ",..."
"""The end of a list of values that repeat, one for each frame."""


def read_mosaic(text: str) -> Mosaic | str:
    """Return the mosaic of an option: letters, or the mosaic in a file of JSON.

    Raises
    ------
    ValueError
        When the file holds no mosaic.
    """
    if not text.endswith(".json"):
        return text
    path = Path(text)
    try:
        content = json.loads(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path}: expected an object of JSON: {error}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected an object with pattern and filters")
    try:
        return Mosaic.of(content)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def number_or_map(name: str, text: str) -> float | npt.NDArray[Any]:
    """Return the number of an option, or the map in a file."""
    if is_map(text):
        return read_map(text)
    try:
        return float(text)
    except ValueError:
        raise ValueError(
            f"{name}: expected a number, or a .npy or .tif map, got {text!r}"
        ) from None


def values_of_frames(
    name: str, text: str, kind: Callable[[str], float], frames: int | None
) -> float | npt.NDArray[Any]:
    """Return a number, the values of all frames, or for thresholds the map in a file.

    Raises
    ------
    ValueError
        When a value is no number, or the frames are no multiple of the values.
    """
    if name == "threshold" and is_map(text):
        return read_map(text)
    repeats, text = text.endswith(_REPEATS), text.removesuffix(_REPEATS)
    try:
        values = [kind(part) for part in text.split(",")]
    except ValueError:
        some = ", or a .npy or .tif map" if name == "threshold" else ""
        raise ValueError(
            f"{name}: expected a number, or several such as 64,8,1{some}, got {text!r}"
        ) from None
    if len(values) == 1:
        return values[0]
    if frames is None or (frames % len(values) and not repeats):
        got = "none" if frames is None else f"--frames {frames}"
        raise ValueError(
            f"{name}: with {len(values)} values, expected a multiple of {len(values)} frames in "
            f"--frames, got {got}"
        )
    return np.resize(values, frames) if repeats else np.repeat(values, frames // len(values))
