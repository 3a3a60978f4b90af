"""Data sets of visionsim: a `transforms.json`, and `.npy` files of frames next to or below it."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.files import atomic_folder
from jotlight.formats.arrays import open_npy_array, write_npy
from jotlight.formats.capture import Capture, CountStack
from jotlight.formats.count_stacks import as_count_stack
from jotlight.formats.format import Format, OpenOptions, Writer
from jotlight.formats.orientation import transpose_packed
from jotlight.formats.packing import pack_lazily
from jotlight.formats.safe_paths import check_inside, resolve_below
from jotlight.formats.scaled import unscale
from jotlight.output_files import open_output
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, concatenate, read_frames, read_in_chunks
from jotlight.sensing.provenance import Provenance

_FILE_NAME = "transforms.json"

_MAX_JSON_BYTES = 1 << 27
"""Maximum size of `transforms.json` in bytes. The pose of each frame takes about 100 bytes."""

_MAX_PLANES = 127
"""Maximum number of single bits in a value that is recognized. Of more, values are ambiguous."""

_MAX_OFFSET = 2**48
"""Upper limit of the index of a frame in its file."""


@dataclasses.dataclass(frozen=True)
class _Run:
    """Consecutive frames of one file."""

    file: Any
    """Name of the file, unchecked."""
    start: int
    stop: int | None
    """Index after the last frame. None: all frames of the file."""
    packed_axis: Any
    """Axis along which bits are packed, 1 or 2, unchecked. None: the bits are not packed."""


def _is_visionsim(path: Path) -> bool:
    file = path / _FILE_NAME if path.is_dir() else path
    return file.name == _FILE_NAME and file.is_file()


def open_visionsim(path: Path, options: OpenOptions) -> Capture:
    """Return the bits or the counts of a folder with a `transforms.json`, or of that file."""
    file = path / _FILE_NAME if path.is_dir() else path
    if not file.is_file():
        raise FileNotFoundError(f"there is no file {file}")
    if path.is_dir():
        check_inside(file, path)
    try:
        return _open_frames(file, _read_json(file), options)
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        message = str(error)
        raise ValueError(message if str(file) in message else f"{file}: {message}") from error


def _read_json(path: Path) -> dict[str, Any]:
    if path.stat().st_size > _MAX_JSON_BYTES:
        raise ValueError(f"expected at most {_MAX_JSON_BYTES} bytes, got {path.stat().st_size}")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected JSON ({error})") from error
    if not isinstance(content, dict) or not isinstance(content.get("frames"), list):
        raise ValueError("expected a data set of visionsim, an object with a list of frames")
    return content


def _open_frames(path: Path, content: dict[str, Any], options: OpenOptions) -> Capture:
    parts, widths, is_multibit = [], set(), False
    for run in _list_runs(content):
        array = open_npy_array(resolve_below(path, run.file, "file_path"))
        if run.stop is not None and run.stop > len(array):
            raise ValueError(
                f"file_path: expected {run.stop} frames in {run.file}, got {len(array)}"
            )
        part = array[run.start : run.stop]
        frames, width = _pack_along_width(part, run.packed_axis, content)
        if run.packed_axis is None and not _has_bits(part):
            is_multibit, frames = True, part
        parts.append(frames)
        widths.add(width)
    if len(widths) != 1 or len({part.shape[1:] for part in parts}) != 1:
        raise ValueError("frames: expected at least one, and frames of one size")
    packed = concatenate(parts)
    if is_multibit:
        return _open_sums(packed, path, options)
    stated = len(content["frames"])
    if len(packed) != stated:
        warn(
            f"{path}: lists {stated} frames, but there are {len(packed)}; only the smaller number "
            "is used"
        )
        packed = packed[: min(stated, len(packed))]
    provenance = Provenance("visionsim", path.parent.name or path.name)
    return Bits(packed, widths.pop(), provenance=provenance)


def _has_bits(frames: npt.NDArray[Any] | Frames) -> bool:
    """Return whether the first frame has only two values, as those of single bits."""
    levels = set(np.unique(np.asarray(frames[:1])).tolist())
    return frames.dtype == np.bool_ or levels <= {0, 1} or levels <= {0, 255}


def _open_sums(images: npt.NDArray[Any] | Frames, path: Path, options: OpenOptions) -> CountStack:
    """Return the counts of a cube of several bits, which are means of single bits, times 255.

    A sensor of several bits in visionsim adds single bits, so its frames are counts.
    """
    if images.ndim == 4 and images.shape[3] == 1:
        images = images[..., 0]
    provenance = Provenance("visionsim", path.parent.name or path.name)
    stack = as_count_stack(images, provenance, floats=options.floats, is_stack=True)
    trials = None if options.floats else _number_of_planes(read_frames(stack.images, 0, 1))
    return stack if trials is None else unscale(stack, 255, trials)


def _number_of_planes(values: npt.NDArray[Any]) -> int | None:
    """Return how many single bits explain values k · 255 / number, rounded down, or None.

    Numbers 2^b - 1, of sensors of b bits, are tried first.

    Examples
    --------
    >>> _number_of_planes(np.array([0, 36, 145, 255])), _number_of_planes(np.arange(9))
    (7, None)
    """
    levels = set(np.unique(values).tolist())
    depths = [3, 7, 15, 31, 63, 127]
    for number in [*depths, *(n for n in range(2, _MAX_PLANES + 1) if n not in depths)]:
        if levels <= {255 * k // number for k in range(number + 1)}:
            return number
    return None


def _list_runs(content: dict[str, Any]) -> list[_Run]:
    """Return the runs of frames that the data set lists, in order."""
    if "file_path" in content:
        axis = content.get("bitpack_dim", 2) if content.get("bitpack") else None
        return [_Run(content["file_path"], 0, None, axis)]
    runs: list[_Run] = []
    for frame in content["frames"]:
        if not isinstance(frame, dict):
            raise ValueError(f"frames: expected objects, got {type(frame).__name__}")
        file, offset = frame.get("file_path"), frame.get("offset", 0)
        axis = frame.get("bitpack_dim", content.get("bitpack_dim"))
        if type(offset) is not int or not 0 <= offset < _MAX_OFFSET:
            raise ValueError(f"offset: expected a whole number of 0 or more, got {offset!r}")
        last = runs[-1] if runs else None
        if last and (last.file, last.stop, last.packed_axis) == (file, offset, axis):
            runs[-1] = dataclasses.replace(last, stop=offset + 1)
        else:
            runs.append(_Run(file, offset, offset + 1, axis))
    return runs


def _pack_along_width(
    array: npt.NDArray[Any] | Frames, axis: Any, content: dict[str, Any]
) -> tuple[npt.NDArray[np.uint8] | Frames, int]:
    """Return the frames of one file, packed along the width, and their width in jots."""
    if array.ndim not in (3, 4) or array.dtype not in (np.uint8, np.bool_):
        raise ValueError(
            f"expected frames (T, H, W) or (T, H, W, C) in uint8 or bool, got {array.dtype} of "
            f"shape {array.shape}"
        )
    if axis not in (None, 1, 2):
        raise ValueError(f"bitpack_dim: expected 1 or 2, the height or the width, got {axis!r}")
    if array.ndim == 4 and array.shape[3] == 1:
        array = array[..., 0]
    height, width = _read_size(array.shape, axis, content)
    if axis == 2:
        return array, width
    if axis == 1:
        return _repack(array, height, width), width
    return pack_lazily(array, "visionsim"), width


def _read_size(shape: tuple[int, ...], axis: Any, content: dict[str, Any]) -> tuple[int, int]:
    """Return height and width in jots, which must agree with the shape of the array."""
    sizes: list[Any] = [content.get("h", shape[1]), content.get("w", shape[2])]
    if axis is not None:
        sizes[axis - 1] = content.get("hw"[axis - 1], 8 * shape[axis])
    if any(type(size) is not int or size < 1 for size in sizes):
        raise ValueError(f"h, w: expected whole numbers, got {sizes[0]!r} and {sizes[1]!r}")
    stored = list(sizes)
    if axis is not None:
        stored[axis - 1] = (stored[axis - 1] + 7) // 8
    if list(shape[1:3]) != stored or content.get("c", 1) not in (1, *shape[3:]):
        raise ValueError(
            f"h, w, c: describe frames stored as {stored[0]} x {stored[1]} with "
            f"{content.get('c', 1)} channels, but the file has {shape[1:]}"
        )
    return sizes[0], sizes[1]


def _repack(array: npt.NDArray[np.uint8] | Frames, height: int, width: int) -> Frames:
    """Return frames packed along the width, from frames packed along the height.

    The shape of `array` is (T, ceil(H / 8), W) or (T, ceil(H / 8), W, C).
    """
    channels = array.shape[3:]
    shape = (len(array), height, (width + 7) // 8, *channels)

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        packed = np.empty((stop - start, *shape[1:]), np.uint8)
        for place, part in read_in_chunks(array[start:stop]):
            columns = part.swapaxes(1, 2)
            for channel in range(channels[0] if channels else 0):
                packed[place, ..., channel] = transpose_packed(columns[..., channel], height)
            if not channels:
                packed[place] = transpose_packed(columns, height)
        return packed

    return Frames(shape, read)


def _write_bits(bits: Bits, path: Path) -> None:
    """Write a data set with the pose of every frame at the origin."""
    frames, height, width, *channels = bits.shape
    channel = channels[0] if channels else 1
    shape = (frames, height, (width + 7) // 8, channel)
    with atomic_folder(path) as folder:
        with open_output(folder / "frames.npy") as file:
            write_npy(file, bits.packed, shape)
        content = {
            "w": width,
            "h": height,
            "c": channel,
            "bitpack": True,
            "bitpack_dim": 2,
            "file_path": "frames.npy",
            "frames": [{"transform_matrix": np.eye(4).tolist()}] * frames,
        }
        (folder / _FILE_NAME).write_text(json.dumps(content))


VISIONSIM = Format(
    "visionsim",
    "a data set of visionsim, with transforms.json",
    open=open_visionsim,
    matches=_is_visionsim,
    fixed_layout=True,
    writer=Writer(bits=_write_bits, folder=True),
)
