"""Data sets of visionsim: a `transforms.json`, and `.npy` files of frames next to or below it."""

import array
import dataclasses
import itertools
import json
from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.files import atomic_folder
from jotlight.formats.capture import Capture, CountStack
from jotlight.formats.files.safe_paths import check_inside, resolve_below
from jotlight.formats.format import Format, Writer
from jotlight.formats.frames.count_stacks import as_count_stack
from jotlight.formats.frames.orientation import transpose_packed
from jotlight.formats.frames.packing import pack_lazily
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.frames.scaled import unscale
from jotlight.formats.npy.arrays import open_npy_array, write_npy
from jotlight.output_files import open_output
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames, read_frames, read_in_chunks
from jotlight.sensing.parameters.provenance import Provenance

_FILE_NAME = "transforms.json"

_MAX_JSON_BYTES = 1 << 27
"""Maximum size of `transforms.json` in bytes. The pose of each frame takes about 100 bytes."""

_MAX_PLANES = 127
"""Maximum number of single bits in a value that is recognized. Of more, values are ambiguous."""

_MAX_OFFSET = 2**48
"""Upper limit of the index of a frame in its file."""

_EXPECTED = "frames: expected at least one, and frames of one size"

_Stack = npt.NDArray[Any] | Frames


@dataclasses.dataclass(frozen=True)
class _Listing:
    """The frames that a data set lists. A hostile one lists the same few files any number of times.

    So each file is opened and inspected once, and the rest is arithmetic on arrays.
    """

    files: list[tuple[str, int | None]]
    """Names of the files, and the axes along which their bits are packed: 1, 2, or None."""
    places: npt.NDArray[np.int64] | None
    """(T, 2): for each frame, the index of its file, and its index in that file. None: all frames
    of the only file."""


def _is_visionsim(path: Path) -> bool:
    file = path / _FILE_NAME if path.is_dir() else path
    return file.name == _FILE_NAME and file.is_file()


def open_visionsim(path: Path, options: ReadingOptions) -> Capture:
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


def _open_frames(path: Path, content: dict[str, Any], options: ReadingOptions) -> Capture:
    listing = _list_frames(content)
    stacks = [open_npy_array(resolve_below(path, name, "file_path")) for name, _ in listing.files]
    _check_places(listing, stacks)
    axes = [axis for _, axis in listing.files]
    packed = [
        _pack_along_width(stack, axis, content) for stack, axis in zip(stacks, axes, strict=True)
    ]
    widths = {width for _, width in packed}
    if len(widths) != 1:
        raise ValueError(_EXPECTED)
    firsts = zip(_first_frames(listing, stacks), axes, strict=True)
    if any(axis is None and not _has_bits(frame) for frame, axis in firsts):
        return _open_sums(_select(stacks, listing.places), path, options)
    frames = _select([stack for stack, _ in packed], listing.places)
    stated = len(content["frames"])
    if len(frames) != stated:
        warn(
            f"{path}: lists {stated} frames, but there are {len(frames)}; only the smaller number "
            "is used"
        )
        frames = frames[: min(stated, len(frames))]
    provenance = Provenance("visionsim", path.parent.name or path.name)
    return Bits(frames, widths.pop(), provenance=provenance)


def _has_bits(frame: _Stack) -> bool:
    """Return whether a frame has only two values, as those of single bits."""
    levels = set(np.unique(np.asarray(frame)).tolist())
    return frame.dtype == np.bool_ or levels <= {0, 1} or levels <= {0, 255}


def _open_sums(
    images: npt.NDArray[Any] | Frames, path: Path, options: ReadingOptions
) -> CountStack:
    """Return the counts of a cube of several bits, which are means of single bits, times 255.

    A sensor of several bits in visionsim adds single bits, so its frames are counts.
    """
    if images.ndim == 4 and images.shape[3] == 1:
        images = images[..., 0]
    provenance = Provenance("visionsim", path.parent.name or path.name)
    stack = as_count_stack(images, provenance, floats=options.takes_floats, is_stack=True)
    trials = None if options.takes_floats else _number_of_planes(read_frames(stack.images, 0, 1))
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


def _list_frames(content: dict[str, Any]) -> _Listing:
    """Return the frames that the data set lists, in order."""
    if "file_path" in content:
        axis = content.get("bitpack_dim", 2) if content.get("bitpack") else None
        return _Listing([(_check_name(content["file_path"]), _check_axis(axis))], None)
    files: dict[tuple[str, int | None], int] = {}
    places = array.array("q")
    for frame in content["frames"]:
        if not isinstance(frame, dict):
            raise ValueError(f"frames: expected objects, got {type(frame).__name__}")
        offset = frame.get("offset", 0)
        if type(offset) is not int or not 0 <= offset < _MAX_OFFSET:
            raise ValueError(f"offset: expected a whole number of 0 or more, got {offset!r}")
        axis = _check_axis(frame.get("bitpack_dim", content.get("bitpack_dim")))
        key = _check_name(frame.get("file_path")), axis
        places.extend((files.setdefault(key, len(files)), offset))
    return _Listing(list(files), np.asarray(places).reshape(-1, 2))


def _check_name(name: object) -> str:
    """Return the name of a file in one spelling: "./a.npy" becomes "a.npy"."""
    if not isinstance(name, str):
        raise ValueError(
            f"file_path: expected the name of a file in the same folder or below, got {name!r}"
        )
    return str(PurePath(name)) if name else name


def _check_axis(axis: Any) -> int | None:
    if axis not in (None, 1, 2):
        raise ValueError(f"bitpack_dim: expected 1 or 2, the height or the width, got {axis!r}")
    return None if axis is None else int(axis)


def _check_places(listing: _Listing, stacks: list[_Stack]) -> None:
    """Raise ValueError unless all listed frames exist, and are at most as many as all frames."""
    if listing.places is None:
        return
    ends = np.zeros(len(stacks), np.int64)
    np.maximum.at(ends, listing.places[:, 0], listing.places[:, 1] + 1)
    for stack, end, (name, _) in zip(stacks, ends.tolist(), listing.files, strict=True):
        if end > len(stack):
            raise ValueError(f"file_path: expected {end} frames in {name}, got {len(stack)}")
    stated, stored = len(listing.places), sum(map(len, stacks))
    if stated > stored:
        raise ValueError(
            f"frames: expected each frame once, got a list of {stated} frames, but the files hold "
            f"{stored}"
        )


def _first_frames(listing: _Listing, stacks: list[_Stack]) -> Iterator[_Stack]:
    """Yield the first listed frame of each file."""
    firsts = np.zeros(len(stacks), np.int64)
    if listing.places is not None:
        _, indices = np.unique(listing.places[:, 0], return_index=True)
        firsts = listing.places[indices, 1]
    for stack, first in zip(stacks, firsts.tolist(), strict=True):
        yield stack[first : first + 1]


def _select(stacks: list[_Stack], places: npt.NDArray[np.int64] | None) -> _Stack:
    """Return the frames at some places as one stack, without reading them."""
    if len({(stack.shape[1:], stack.dtype) for stack in stacks}) != 1:
        raise ValueError(_EXPECTED)
    if places is None:
        return stacks[0]
    follows = (np.diff(places, axis=0) == (0, 1)).all(axis=1)
    starts = np.concatenate([[0], 1 + np.flatnonzero(~follows)])  # of runs of successive frames
    if len(starts) == 1:
        return stacks[0][int(places[0, 1]) : int(places[-1, 1]) + 1]

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        out = np.empty((stop - start, *stacks[0].shape[1:]), stacks[0].dtype)
        inner = starts[(starts > start) & (starts < stop)].tolist()
        for first, last in itertools.pairwise([start, *inner, stop]):
            index, offset = places[first].tolist()
            out[first - start : last - start] = stacks[index][offset : offset + last - first, ...]
        return out

    return Frames((len(places), *stacks[0].shape[1:]), read, stacks[0].dtype)


def _pack_along_width(
    array: npt.NDArray[Any] | Frames, axis: int | None, content: dict[str, Any]
) -> tuple[npt.NDArray[np.uint8] | Frames, int]:
    """Return the frames of one file, packed along the width, and their width in jots."""
    if array.ndim not in (3, 4) or array.dtype not in (np.uint8, np.bool_):
        raise ValueError(
            f"expected frames (T, H, W) or (T, H, W, C) in uint8 or bool, got {array.dtype} of "
            f"shape {array.shape}"
        )
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
    writer=Writer(bits=_write_bits, plain=True, folder=True),
)
