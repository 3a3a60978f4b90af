"""Photon cubes: packed bits in a plain `.npy`, and what it cannot say in a `.json` beside it."""

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.bits import Bits
from jotlight.errors import warn
from jotlight.files import written_whole
from jotlight.sensor import Sensor

_FORMAT = "jotlight bits"
_VERSION = 1
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
    except (EOFError, OverflowError, TypeError, SyntaxError) as error:
        raise ValueError(f"{path}: the header of the .npy file is damaged ({error})") from error


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
    _spare_strangers(path, beside, list(map_paths.values()))
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
        yield packed
        packed.flush()
        del packed


def _spare_strangers(path: Path, beside: Path, map_paths: list[Path]) -> None:
    """Refuse to put files that go with the bits where somebody else's stand."""
    ours = (_parse(beside) or {}) if beside.exists() else {}
    named = ours.get("maps") or {}
    for file in [beside, *map_paths]:
        known = ours if file == beside else isinstance(named, dict) and file.name in named.values()
        if file.is_file() and not known:
            raise FileExistsError(
                f"{file} stands where a file that goes with {path.name} would be written, and "
                "jotlight did not write it; move it, or choose another name"
            )


def _read_description(path: Path) -> tuple[int | None, Sensor | None]:
    beside = path.with_suffix(".json")
    if not beside.exists():
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
        maps = {
            str(name): np.array(read_npy(_sibling(path, file)))
            for name, file in dict(description.get("maps") or {}).items()
        }
        return width, Sensor.from_parts(description["sensor"], maps)
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
