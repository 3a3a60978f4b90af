"""Photon cubes: packed bits in a plain `.npy`, and what it cannot say in a `.json` beside it."""

import contextlib
import errno
import json
import lzma
import math
import os
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.bits import Bits
from jotlight.errors import warn
from jotlight.files import written_whole
from jotlight.sensor import MAPS, Sensor

_FORMAT = "jotlight bits"
_VERSION = 1
_DAMAGED = (
    ValueError,
    EOFError,
    OverflowError,
    TypeError,
    SyntaxError,
    RecursionError,
    TokenError,
)
"""What reading a damaged header may raise."""

# RuntimeError for what is encrypted or packed in a way that Python lacks.
_BAD_ARCHIVE = (
    OSError,
    RuntimeError,
    MemoryError,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
)
"""What reading a damaged archive may raise."""

_MOST_JSON = 1 << 20
"""Bytes of a description that are read at most."""


def read_npy(path: str | os.PathLike[str]) -> npt.NDArray[Any]:
    """Memory-map a `.npy` file of numbers.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When it is no `.npy` file, is truncated, or holds Python objects (which are never read).
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"{path}: expected a .npy file, got a folder")
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    with path.open("rb") as file:
        magic = file.read(6)
    if magic != b"\x93NUMPY":
        raise ValueError(f"{path}: expected a .npy file, but it does not begin like one")
    try:
        return np.lib.format.open_memmap(path, mode="r")
    except ValueError as error:
        if "Python objects" in str(error):
            raise ValueError(
                f"{path}: holds Python objects, which can run code and are never read; "
                "save an array of numbers instead"
            ) from error
        raise ValueError(
            f"{path}: expected a whole .npy file, but its size does not fit its header "
            f"or the header is damaged ({error})"
        ) from error
    except _DAMAGED as error:
        raise ValueError(f"{path}: the header of the .npy file is damaged ({error})") from error


def read_npz(path: str | os.PathLike[str], key: str | None = None) -> npt.NDArray[Any]:
    """Read one array of a `.npz` archive, by name where it holds several.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When it is no such archive, is damaged, holds Python objects, or has no array `key`.
    """
    path = Path(path)
    names = npz_names(path)
    if key is None and len(names) == 1:
        key = names[0]
    if key not in names:
        told = "" if key is None else f", got {key!r}"
        raise ValueError(f"{path}: expected the name of an array (--key): {', '.join(names)}{told}")
    try:
        with zipfile.ZipFile(path) as archive:
            _check_size(archive, f"{key}.npy")
            # NumPy's own reader of archives hands out the bytes of what is no array.
            with archive.open(f"{key}.npy") as member:
                return np.asarray(np.lib.format.read_array(member, allow_pickle=False))
    except (*_DAMAGED, *_BAD_ARCHIVE) as error:
        if "Object arrays" in str(error):
            raise ValueError(
                f"{path}: {key} holds Python objects, which can run code and are never read; "
                "save an array of numbers instead"
            ) from error
        raise ValueError(f"{path}: the array {key} is damaged ({error})") from error


def _check_size(archive: zipfile.ZipFile, name: str) -> None:
    """Raise ValueError when a member's header asks for more memory than the member has bytes."""
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    with archive.open(name) as member:
        version = np.lib.format.read_magic(member)
        if version not in readers:
            raise ValueError(f"expected version 1 or 2 of the .npy format, got {version}")
        shape, _, dtype = readers[version](member)
    size, there = math.prod(shape) * dtype.itemsize, archive.getinfo(name).file_size
    if not dtype.hasobject and not 0 <= size <= there:
        raise ValueError(f"its header tells of {size} bytes, but there are {there}")


def npz_names(path: Path) -> list[str]:
    """The names of the arrays in a `.npz` archive."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.namelist()
    except _BAD_ARCHIVE as error:
        raise ValueError(f"{path}: expected a .npz archive ({error})") from error
    names = [name.removesuffix(".npy") for name in members if name.endswith(".npy")]
    if not names:
        raise ValueError(f"{path}: expected a .npz archive of arrays, got none in it")
    return names


def is_cube(array: npt.NDArray[Any]) -> bool:
    """Whether an array looks like packed bits, (T, H, W/8) or (T, H, W/8, C)."""
    return array.dtype == np.uint8 and array.ndim in (3, 4)


def load_bits(path: str | os.PathLike[str], *, width: int | None = None) -> Bits:
    """Open a photon cube with what the `.json` beside it says."""
    path = Path(path)
    packed = read_npy(path)
    if not is_cube(packed):
        raise ValueError(
            f"{path}: expected packed bits, uint8 of shape (T, H, W/8) or (T, H, W/8, C), "
            f"got {packed.dtype} of shape {packed.shape}; Bits.from_array packs unpacked bits, "
            "and an image of counts goes to a method as it is"
        )
    told_width, sensor = _read_description(path)
    if width is not None and told_width is not None and width != told_width:
        raise ValueError(
            f"{path}: the description beside it says a width of {told_width}, not {width}"
        )
    try:
        return Bits(packed, width if width is not None else told_width, sensor)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def save_bits(bits: Bits, path: str | os.PathLike[str]) -> None:
    """Write bits and their description, whole or not at all."""
    with created_bits(path, bits.packed.shape, bits.width, bits.sensor) as packed:
        packed[...] = bits.packed


@contextlib.contextmanager
def created_bits(
    path: str | os.PathLike[str],
    shape: tuple[int, ...],
    width: int,
    sensor: Sensor | None,
) -> Iterator[npt.NDArray[np.uint8]]:
    """Give a memory map of packed bits to fill; file and description appear when the block ends."""
    path = Path(path)
    if path.suffix != ".npy":
        raise ValueError(f"{path}: expected a name that ends in .npy for packed bits")
    beside = path.with_suffix(".json")
    maps = {} if sensor is None else sensor.maps()
    map_paths = {name: path.with_suffix(f".{name}.npy") for name in maps}
    former = _maps_named_by(beside)
    foreign = [beside] if beside.is_file() and _parse(beside) is None else []
    foreign += [path for path in map_paths.values() if path.is_file() and path not in former]
    if foreign:
        raise FileExistsError(
            f"{foreign[0]} stands where a file that goes with {path.name} would be written, and "
            "jotlight did not write it for these bits; move it, or choose another name"
        )
    description: dict[str, Any] = {"format": _FORMAT, "version": _VERSION, "width": width}
    with contextlib.ExitStack() as stack:
        # What is entered first is put in place last: the bits once all that describes them stands.
        cube = stack.enter_context(written_whole(path))
        text = stack.enter_context(written_whole(beside))
        if sensor is not None:
            description["sensor"] = sensor.numbers()
            description["maps"] = {}
            for name, map_ in maps.items():
                with stack.enter_context(written_whole(map_paths[name])).open("wb") as file:
                    np.save(file, map_)
                description["maps"][name] = map_paths[name].name
        text.write_text(json.dumps(description, indent=2) + "\n")
        packed = np.lib.format.open_memmap(cube, mode="w+", dtype=np.uint8, shape=shape)
        # Filling a memory map whose blocks the disk does not have would end the program.
        _allocate(cube)
        yield packed
        packed.flush()
        del packed
    for stale in former - set(map_paths.values()):
        stale.unlink(missing_ok=True)


def _allocate(path: Path) -> None:
    """Take all blocks of a file now, where the system and the disk know how."""
    if not hasattr(os, "posix_fallocate"):
        return
    try:
        with path.open("r+b") as file:
            os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
    except OSError as error:
        if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL):
            raise


def maps_beside(path: Path) -> set[Path]:
    """The files that bits in `path` have beside them: their description and the sensor's maps."""
    beside = path.with_suffix(".json")
    return {beside, *_maps_named_by(beside)} if path.suffix == ".npy" else set()


def _maps_named_by(beside: Path) -> set[Path]:
    """The maps in the same folder that a description of ours names."""
    description = (_parse(beside) or {}) if beside.is_file() else {}
    maps = description.get("maps")
    names = maps.values() if isinstance(maps, dict) else ()
    stem = beside.name.removesuffix(".json")
    ours = {f"{stem}.{name}.npy" for name in MAPS}
    return {beside.parent / name for name in names if name in ours}


def _read_description(path: Path) -> tuple[int | None, Sensor | None]:
    beside = path.with_suffix(".json")
    if not beside.is_file():
        return None, None
    description = _parse(beside)
    if description is None:
        warn(f"{beside} does not describe bits of jotlight and is not used")
        return None, None
    width = description.get("width")
    if description.get("version") != _VERSION or not isinstance(width, int) or width < 1:
        raise ValueError(
            f"{beside}: expected version {_VERSION} and a width, got version "
            f"{description.get('version')!r} and width {width!r}"
        )
    if description.get("sensor") is None:
        return width, None
    try:
        files = description.get("maps") or {}
        if not isinstance(files, dict) or not files.keys() <= set(MAPS):
            raise ValueError(f"maps: expected files for {' and '.join(MAPS)}, got {files!r}")
        maps = {name: np.array(read_npy(_sibling(path, file))) for name, file in files.items()}
        return width, Sensor.from_parts(description["sensor"], maps)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{beside}: {error}") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{beside}: {error}") from error


def _parse(path: Path) -> dict[str, Any] | None:
    """The description in a file, or None when it is none of ours."""
    if path.stat().st_size > _MOST_JSON:
        return None
    try:
        description = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return None
    if isinstance(description, dict) and description.get("format") == _FORMAT:
        return description
    return None


def _sibling(path: Path, name: object) -> Path:
    """A file in the same folder: a description from a stranger must not point elsewhere."""
    if not isinstance(name, str) or Path(name).name != name or name in ("", ".", ".."):
        raise ValueError(f"maps: expected the name of a file in the same folder, got {name!r}")
    return path.parent / name
