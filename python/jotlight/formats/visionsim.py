"""Data sets of visionsim: a `transforms.json`, and frames in `.npy` files beside or below it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.formats.arrays import read_npy
from jotlight.formats.capture import pack_lazily
from jotlight.formats.description import resolve_below
from jotlight.formats.orientation import transpose_packed
from jotlight.memory_maps import release
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, concatenate, read_in_chunks
from jotlight.sensing.provenance import Provenance

NAME = "transforms.json"

_MOST_JSON = 1 << 27
"""Bytes of a description that are read at most; a pose takes some 100."""


def open_visionsim(path: Path) -> Bits:
    """Open a folder with a `transforms.json`, or that file."""
    described = path / NAME if path.is_dir() else path
    if not described.is_file():
        raise FileNotFoundError(f"there is no file {described}")
    try:
        return _open(described, _parsed(described))
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        told = str(error)
        raise ValueError(told if str(described) in told else f"{described}: {told}") from error


def _parsed(path: Path) -> dict[str, Any]:
    if path.stat().st_size > _MOST_JSON:
        raise ValueError(f"expected at most {_MOST_JSON} bytes, got {path.stat().st_size}")
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected JSON ({error})") from error
    if not isinstance(told, dict) or not isinstance(told.get("frames"), list):
        raise ValueError("expected a data set of visionsim, an object with a list of frames")
    return told


def _open(path: Path, told: dict[str, Any]) -> Bits:
    parts, widths = [], set()
    for file, first, last, dim in _runs(told):
        array = read_npy(resolve_below(path, file, "file_path"))
        if last is not None and last > len(array):
            raise ValueError(f"file_path: expected {last} frames in {file}, got {len(array)}")
        frames, width = _bits(array[first:last], dim, told)
        parts.append(frames)
        widths.add(width)
    if len(widths) != 1 or len({part.shape[1:] for part in parts}) != 1:
        raise ValueError("frames: expected at least one, and frames of one size")
    packed = concatenate(parts)
    number = len(told["frames"])
    if len(packed) != number:
        warn(f"{path}: tells of {number} frames, and there are {len(packed)}; the fewer are used")
        packed = packed[: min(number, len(packed))]
    provenance = Provenance("visionsim", path.parent.name or path.name)
    return Bits(packed, widths.pop(), provenance=provenance)


def _runs(told: dict[str, Any]) -> list[tuple[Any, int, int | None, Any]]:
    """Files, with the first and last frame that is taken of each and the dimension packed."""
    packed = told.get("bitpack_dim", 2) if told.get("bitpack") else None
    if "file_path" in told:
        return [(told["file_path"], 0, None, packed)]
    runs: list[tuple[Any, int, int | None, Any]] = []
    for frame in told["frames"]:
        if not isinstance(frame, dict):
            raise ValueError(f"frames: expected objects, got {type(frame).__name__}")
        file, offset = frame.get("file_path"), frame.get("offset", 0)
        dim = frame.get("bitpack_dim", told.get("bitpack_dim"))
        if type(offset) is not int or not 0 <= offset < 2**48:
            raise ValueError(f"offset: expected a whole number of 0 or more, got {offset!r}")
        if runs and runs[-1][0] == file and runs[-1][2] == offset and runs[-1][3] == dim:
            runs[-1] = (file, runs[-1][1], offset + 1, dim)
        else:
            runs.append((file, offset, offset + 1, dim))
    return runs


def _bits(
    array: npt.NDArray[Any], dim: Any, told: dict[str, Any]
) -> tuple[npt.NDArray[np.uint8] | Frames, int]:
    """Frames of one file, packed along the width, and their width."""
    if array.ndim not in (3, 4) or array.dtype not in (np.uint8, np.bool_):
        raise ValueError(
            f"expected frames (T, H, W) or (T, H, W, C) in uint8 or bool, got {array.dtype} of "
            f"shape {array.shape}"
        )
    if dim not in (None, 1, 2):
        raise ValueError(f"bitpack_dim: expected 1 or 2, the height or the width, got {dim!r}")
    if array.ndim == 4 and array.shape[3] == 1:
        array = array[..., 0]
    sizes: list[Any] = [told.get(name, array.shape[axis]) for name, axis in (("h", 1), ("w", 2))]
    if dim is not None:
        sizes[dim - 1] = told.get("hw"[dim - 1], 8 * array.shape[dim])
    if any(type(size) is not int or size < 1 for size in sizes):
        raise ValueError(f"h, w: expected whole numbers, got {sizes[0]!r} and {sizes[1]!r}")
    height, width = sizes
    expected = [height, width]
    if dim is not None:
        expected[dim - 1] = (expected[dim - 1] + 7) // 8
    if list(array.shape[1:3]) != expected or told.get("c", 1) not in (1, *array.shape[3:]):
        raise ValueError(
            f"h, w, c: tell of frames stored as {expected[0]} x {expected[1]} with "
            f"{told.get('c', 1)} channels, and the file has {array.shape[1:]}"
        )
    if dim == 2:
        return array, width
    if dim == 1:
        return _packed_along_width(array, height, width), width
    return pack_lazily(array, "visionsim"), width


def _packed_along_width(array: npt.NDArray[np.uint8], height: int, width: int) -> Frames:
    """Frames that are packed along the height, (T, ceil(H / 8), W) or with C channels."""
    channels = array.shape[3:]
    shape = (len(array), height, (width + 7) // 8, *channels)

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        out = np.empty((stop - start, *shape[1:]), np.uint8)
        for place, part in read_in_chunks(array[start:stop]):
            columns = part.swapaxes(1, 2)
            for channel in range(channels[0] if channels else 0):
                out[place, ..., channel] = transpose_packed(columns[..., channel], height)
            if not channels:
                out[place] = transpose_packed(columns, height)
        return out

    return Frames(shape, read)


def write_visionsim(folder: Path, bits: Bits) -> None:
    """Write a data set into an empty folder."""
    frames, height, width, *channels = bits.shape
    channel = channels[0] if channels else 1
    shape = (frames, height, (width + 7) // 8, channel)
    cube = np.lib.format.open_memmap(folder / "frames.npy", mode="w+", dtype=np.uint8, shape=shape)
    for place, part in read_in_chunks(bits.packed):
        cube[place] = part.reshape(len(part), *shape[1:])
        release(cube[place])
    cube.flush()
    pose = np.eye(4).tolist()
    told = {
        "w": width,
        "h": height,
        "c": channel,
        "bitpack": True,
        "bitpack_dim": 2,
        "file_path": "frames.npy",
        "frames": [{"transform_matrix": pose}] * frames,
    }
    (folder / NAME).write_text(json.dumps(told))
