"""MATLAB: a `.mat` with frames (H, W, T), or a folder of `part_1.mat`, `part_2.mat` and so on."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.files import atomic_folder
from jotlight.formats.capture import Capture, as_count_stack
from jotlight.formats.file_lists import natural_sort_key
from jotlight.formats.format import Format, OpenOptions, Writer
from jotlight.formats.hdf5 import list_data_sets
from jotlight.formats.limits import check_claimed_size
from jotlight.formats.magic import has_type
from jotlight.formats.mat_sizes import check_sizes
from jotlight.formats.packing import pack_lazily
from jotlight.formats.safe_paths import check_inside
from jotlight.output_files import open_output
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, concatenate
from jotlight.sensing.provenance import Provenance

_VARIABLE = "OUTPUT"
"""Name of the variable that the software of cameras and jotlight write."""

_FRAMES_PER_PART = 256
"""Number of frames in each file that jotlight writes."""

_NUMERIC_CLASSES = {
    *("logical", "uint8", "int8", "uint16", "int16", "uint32", "int32", "single", "double"),
}
"""Classes of variables that can contain frames."""

_MAX_INFO_BYTES = 1 << 20


def _is_matlab(path: Path) -> bool:
    if path.is_dir():
        return next(path.glob("part_*.mat"), None) is not None
    return has_type(path, "matlab")


def open_matlab(path: Path, options: OpenOptions) -> Capture:
    """Return the capture in a `.mat` file, or in a folder of parts in natural order."""
    files, notes, total = [path], [], None
    if path.is_dir():
        files = sorted(path.glob("part_*.mat"), key=natural_sort_key)
        if not files:
            raise ValueError(f"{path}: expected part_1.mat and so on, got none")
        files = [check_inside(file, path) for file in files]
        total = _read_info(path, len(files))
        notes.append(f"{len(files)} parts in the natural order of their names")
    elif not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    parts = [_open_part(file, options.key) for file in files]
    if len({part.shape[1:] for part in parts}) != 1:
        raise ValueError(f"{path}: expected parts of one height and width")
    frames = concatenate(parts)
    if total is not None and total < len(frames):
        notes.append(f"the first {total} of {len(frames)} frames, as info.json states")
        frames = frames[:total]
    if 0 in frames.shape:
        raise ValueError(f"{path}: expected frames without a dimension of 0, got {frames.shape}")
    provenance = Provenance("matlab", path.name, tuple(notes))
    if options.counts:
        return as_count_stack(frames, provenance)
    provenance = provenance.with_notes("each number is one bit, (H, W, T)")
    return Bits(pack_lazily(frames, path.name), frames.shape[2], provenance=provenance)


def _read_info(folder: Path, parts: int) -> int | None:
    """Return the number of frames that `info.json` states, or None if there is no such file."""
    path = folder / "info.json"
    if not path.is_file():
        return None
    check_inside(path, folder)
    try:
        if path.stat().st_size > _MAX_INFO_BYTES:
            raise ValueError("it is too long")
        info = json.loads(path.read_text(encoding="utf-8"))
        stated_parts, stated_frames = info["no_parts"], info["no_frames"]
        if type(stated_parts) is not int or type(stated_frames) is not int or stated_frames < 1:
            raise ValueError(f"got {stated_parts!r} and {stated_frames!r}")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(
            f"{path}: expected whole numbers no_parts and no_frames ({error})"
        ) from error
    if stated_parts != parts:
        warn(
            f"{folder}: info.json states {stated_parts} parts, but there are {parts}; all are used"
        )
    return int(stated_frames)


def _open_part(path: Path, key: str | None) -> Frames:
    """Return the frames of one file, (T, H, W)."""
    with path.open("rb") as file:
        start = file.read(128)
    if b"MATLAB 7.3" in start or start.startswith(b"\x89HDF"):
        return _open_version_7_3(path, key)
    return _open_version_5(path, key)


def _open_version_5(path: Path, key: str | None) -> Frames:
    """Return the frames of a file up to version 7, which SciPy can read only as a whole."""
    from scipy.io import loadmat, whosmat

    try:
        check_sizes(path)
        variables = {name: (shape, kind) for name, shape, kind in whosmat(path)}
    except Exception as error:  # SciPy may raise any exception for a damaged file
        raise ValueError(f"{path}: expected a MATLAB file ({error})") from error
    numeric = {name: shape for name, (shape, kind) in variables.items() if kind in _NUMERIC_CLASSES}
    name = _select_variable(path, numeric, key)
    shape = tuple(int(size) for size in numeric[name])
    shape = (*shape, 1) if len(shape) == 2 else shape
    if len(shape) != 3 or min(shape) < 0:
        raise ValueError(f"{path}: expected {name} of shape (H, W, T), got {shape}")
    check_claimed_size(str(path), math.prod(shape), path.stat().st_size)
    # The cache holds the array until the last frame is read, so reading in order loads it once.
    cache: list[npt.NDArray[Any]] = []

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        if not cache:
            try:
                array = loadmat(path, variable_names=[name], chars_as_strings=False)[name]
            except Exception as error:
                raise ValueError(f"{path}: {name} is damaged ({error})") from error
            if not isinstance(array, np.ndarray) or array.size != math.prod(shape):
                raise ValueError(f"{path}: {name} is damaged")
            cache.append(_as_integers(path, np.moveaxis(array.reshape(shape), 2, 0)))
        part = cache[0][start:stop]
        if stop == shape[2]:
            cache.clear()
        return part

    return Frames((shape[2], *shape[:2]), read, np.int64)


def _open_version_7_3(path: Path, key: str | None) -> Frames:
    """Return the frames of a file of version 7.3, which is HDF5 with dimensions reversed."""
    data_sets = list_data_sets(path)
    name = _select_variable(
        path, {name: array.frames.shape for name, array in data_sets.items()}, key
    )
    data = data_sets[name].frames
    shape = data.shape if len(data.shape) == 3 else (1, *data.shape)
    if len(shape) != 3:
        raise ValueError(f"{path}: expected {name} of shape (H, W, T), got {data.shape[::-1]}")

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        part = data.read(start, stop) if len(data.shape) == 3 else np.asarray(data)[None]
        return _as_integers(path, part.swapaxes(1, 2))

    return Frames((shape[0], shape[2], shape[1]), read, np.int64)


def _select_variable(path: Path, variables: dict[str, Any], key: str | None) -> str:
    if key is None and _VARIABLE in variables:
        return _VARIABLE
    if key is None and len(variables) == 1:
        return next(iter(variables))
    if key is None or key not in variables:
        got = "" if key is None else f", got {key!r}"
        names = ", ".join(map(str, variables)) or "it has no numeric variable"
        raise ValueError(f"{path}: expected the name of a variable (--key): {names}{got}")
    return key


def _as_integers(path: Path, part: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Return whole numbers of any type as int64. MATLAB stores them as floats by default."""
    with np.errstate(invalid="ignore"):
        integers = part.astype(np.int64)
    if part.dtype.kind not in "biuf" or (part.dtype.kind == "f" and (integers != part).any()):
        raise ValueError(f"{path}: expected bits or counts in whole numbers, got {part.dtype}")
    return integers


def _write_bits(bits: Bits, path: Path) -> None:
    """Write a folder of parts and `info.json`."""
    from scipy.io import savemat

    if len(bits.shape) != 3:
        raise ValueError("matlab: expected bits of one channel")
    frames = bits.shape[0]
    with atomic_folder(path) as folder:
        for index, start in enumerate(range(0, frames, _FRAMES_PER_PART)):
            part = bits.packed[start : start + _FRAMES_PER_PART, ...]
            unpacked = np.unpackbits(np.asarray(part), axis=2, count=bits.width)
            # SciPy keeps a third dimension of 1, which MATLAB itself would drop.
            with open_output(folder / f"part_{index + 1}.mat") as file:
                savemat(file, {_VARIABLE: np.moveaxis(unpacked, 0, 2)}, do_compression=True)
        info = {"no_parts": -(-frames // _FRAMES_PER_PART), "no_frames": frames}
        (folder / "info.json").write_text(json.dumps(info))


MATLAB = Format(
    "matlab",
    "MATLAB, a .mat or a folder of parts",
    open=open_matlab,
    matches=_is_matlab,
    extensions=(".mat",),
    has_keys=True,
    writer=Writer(bits=_write_bits, folder=True),
)
