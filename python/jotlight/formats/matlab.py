"""MATLAB: a `.mat` with frames (H, W, T), or a folder of `part_1.mat`, `part_2.mat` and so on."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.formats.capture import Capture, as_count_stack, pack_lazily
from jotlight.formats.hdf5 import open_file
from jotlight.formats.limits import check_claimed_size
from jotlight.formats.mat_sizes import check_sizes
from jotlight.formats.raw import natural_sort_key
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, concatenate
from jotlight.sensing.provenance import Provenance

VARIABLE = "OUTPUT"
FRAMES_PER_PART = 256

_KINDS = ("logical", "uint8", "int8", "uint16", "int16", "uint32", "int32", "single", "double")
_MOST_INFO = 1 << 20


def open_matlab(path: Path, *, key: str | None = None, counts: bool | None = None) -> Capture:
    """Open a `.mat` file, or a folder of parts in natural order."""
    files, notes, total = [path], [], None
    if path.is_dir():
        files = sorted((file for file in path.glob("part_*.mat")), key=natural_sort_key)
        if not files:
            raise ValueError(f"{path}: expected part_1.mat and so on, got none")
        total = _check_info(path, len(files))
        notes.append(f"{len(files)} parts in the natural order of their names")
    elif not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    parts = [_part(file, key) for file in files]
    if len({part.shape[1:] for part in parts}) != 1:
        raise ValueError(f"{path}: expected parts of one height and width")
    frames = concatenate(parts)
    if total is not None and total < len(frames):
        notes.append(f"the first {total} of {len(frames)} frames, as info.json tells")
        frames = frames[:total]
    if 0 in frames.shape:
        raise ValueError(f"{path}: expected frames, none of their sizes 0, got {frames.shape}")
    provenance = Provenance("matlab", path.name, tuple(notes))
    if counts:
        return as_count_stack(frames, provenance)
    provenance = provenance.with_notes("the frames are of one bit each, (H, W, T)")
    return Bits(pack_lazily(frames, path.name), frames.shape[2], provenance=provenance)


def _check_info(folder: Path, parts: int) -> int | None:
    """The number of frames that `info.json` tells, if there is one."""
    info = folder / "info.json"
    if not info.is_file():
        return None
    try:
        if info.stat().st_size > _MOST_INFO:
            raise ValueError("it is too long")
        told = json.loads(info.read_text(encoding="utf-8"))
        no_parts, no_frames = told["no_parts"], told["no_frames"]
        if type(no_parts) is not int or type(no_frames) is not int or no_frames < 1:
            raise ValueError(f"got {no_parts!r} and {no_frames!r}")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(
            f"{info}: expected whole numbers no_parts and no_frames ({error})"
        ) from error
    if no_parts != parts:
        warn(
            f"{folder}: info.json tells of {no_parts} parts, and there are {parts}; these are used"
        )
    return int(no_frames)


def _part(path: Path, key: str | None) -> Frames:
    """One file's frames, (T, H, W); the file is read once for frames that follow each other."""
    with path.open("rb") as file:
        start = file.read(128)
    if b"MATLAB 7.3" in start or start.startswith(b"\x89HDF"):
        return _part_7_3(path, key)
    from scipy.io import loadmat, whosmat

    try:
        check_sizes(path)
        found = {name: (shape, kind) for name, shape, kind in whosmat(path)}
    except Exception as error:  # anything: SciPy's reader does not check what it reads
        raise ValueError(f"{path}: expected a file of MATLAB ({error})") from error
    numbers = {name: shape for name, (shape, kind) in found.items() if kind in _KINDS}
    name = _variable(path, numbers, key)
    shape = tuple(int(size) for size in numbers[name])
    shape = (*shape, 1) if len(shape) == 2 else shape
    if len(shape) != 3 or min(shape) < 0:
        raise ValueError(f"{path}: expected {name} of shape (H, W, T), got {shape}")
    check_claimed_size(str(path), math.prod(shape), path.stat().st_size)
    # The last part that was read, so that going on in it does not read it again.
    kept: list[npt.NDArray[Any]] = []

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        if not kept:
            try:
                array = loadmat(path, variable_names=[name], chars_as_strings=False)[name]
            except Exception as error:
                raise ValueError(f"{path}: {name} is damaged ({error})") from error
            if not isinstance(array, np.ndarray) or array.size != math.prod(shape):
                raise ValueError(f"{path}: {name} is damaged")
            kept.append(_whole(path, np.moveaxis(array.reshape(shape), 2, 0)))
        part = kept[0][start:stop]
        if stop == shape[2]:
            kept.clear()
        return part

    return Frames((shape[2], *shape[:2]), read, np.int64)


def _part_7_3(path: Path, key: str | None) -> Frames:
    file = open_file(path)
    arrays = {name: item.frames.shape for name, item in file.items()}
    name = _variable(path, arrays, key)
    data = file[name].frames
    # HDF5 has the sizes of MATLAB in reverse.
    shape = data.shape if len(data.shape) == 3 else (1, *data.shape)
    if len(shape) != 3:
        raise ValueError(f"{path}: expected {name} of shape (H, W, T), got {data.shape[::-1]}")

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        part = data.read(start, stop) if len(data.shape) == 3 else np.asarray(data)[None]
        return _whole(path, part.swapaxes(1, 2))

    return Frames((shape[0], shape[2], shape[1]), read, np.int64)


def _variable(path: Path, found: dict[str, Any], key: str | None) -> str:
    if key is None and VARIABLE in found:
        return VARIABLE
    if key is None and len(found) == 1:
        return next(iter(found))
    if key not in found:
        told = "" if key is None else f", got {key!r}"
        names = ", ".join(map(str, found)) or "it has none of numbers"
        raise ValueError(f"{path}: expected the name of a variable (--key): {names}{told}")
    return key


def _whole(path: Path, part: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Numbers of any type as whole ones; MATLAB's are floats unless told otherwise."""
    with np.errstate(invalid="ignore"):
        whole = part.astype(np.int64)
    if part.dtype.kind not in "biuf" or (part.dtype.kind == "f" and (whole != part).any()):
        raise ValueError(f"{path}: expected bits or counts in whole numbers, got {part.dtype}")
    return whole


def write_matlab(folder: Path, bits: Bits) -> None:
    """Write parts and `info.json` into an empty folder."""
    from scipy.io import savemat

    if len(bits.shape) != 3:
        raise ValueError("matlab: expected bits of one channel")
    frames = bits.shape[0]
    number = 0
    for start in range(0, frames, FRAMES_PER_PART):
        number += 1
        part = bits.packed[start : start + FRAMES_PER_PART, ...]
        unpacked = np.unpackbits(np.asarray(part), axis=2, count=bits.width)
        # A third size of 1 is kept by SciPy, and dropped by MATLAB.
        savemat(
            folder / f"part_{number}.mat",
            {VARIABLE: np.moveaxis(unpacked, 0, 2)},
            do_compression=True,
        )
    (folder / "info.json").write_text(json.dumps({"no_parts": number, "no_frames": frames}))
