"""Photon cubes: packed bits in a plain `.npy`, and what it cannot say in a `.json` beside it."""

import contextlib
import errno
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.files import atomic_write
from jotlight.formats.arrays import read_npy
from jotlight.formats.capture import check_packed
from jotlight.formats.description import (
    describe,
    description_path,
    maps_in_description,
    read_description,
    read_own_description,
)
from jotlight.memory_maps import release
from jotlight.sensing.bits import Bits, SensorLike
from jotlight.sensing.frames import Frames, read_in_chunks
from jotlight.sensing.provenance import Provenance


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
    return open_described_cube(packed, path, width)


def open_described_cube(
    packed: npt.NDArray[np.uint8] | Frames,
    path: Path,
    width: int | None,
    format_: str = "npy",
    *,
    sure: bool = False,
) -> Bits:
    """Packed bits from a cube, with what the `.json` beside it says.

    Without that, and unless the user is `sure`, its first frames are to look packed.
    """
    told_width, sensor, origin = read_description(path, packed.shape)
    provenance = Provenance(format_, path.name).converted_from(origin)
    if told_width is None:
        if not sure:
            check_packed(packed, str(path))
        provenance = provenance.with_notes(
            "taken for bits, the most significant first, along the width"
        )
        if width is None:
            provenance = provenance.with_notes("the width is taken to be a multiple of 8")
    if width is not None and told_width is not None and width != told_width:
        raise ValueError(
            f"{path}: the description beside it says a width of {told_width}, not {width}"
        )
    try:
        return Bits(packed, width if width is not None else told_width, sensor, provenance)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def write_cube(bits: Bits, path: str | os.PathLike[str]) -> None:
    """Write bits and their description, whole or not at all."""
    with create_bits(path, bits.packed.shape, bits.width, bits.sensor, bits.provenance) as packed:
        for place, part in read_in_chunks(bits.packed):
            packed[place] = part
            release(packed[place])


@contextlib.contextmanager
def create_bits(
    path: str | os.PathLike[str],
    shape: tuple[int, ...],
    width: int,
    sensor: SensorLike | None,
    provenance: Provenance | None = None,
) -> Iterator[npt.NDArray[np.uint8]]:
    """Give a memory map of packed bits to fill; file and description appear when the block ends."""
    path = Path(path)
    if path.suffix != ".npy":
        raise ValueError(f"{path}: expected a name that ends in .npy for packed bits")
    with described(path, shape, width, sensor, provenance) as cube:
        packed = np.lib.format.open_memmap(cube, mode="w+", dtype=np.uint8, shape=shape)
        # Filling a memory map whose blocks the disk does not have would end the program.
        _allocate(cube)
        yield packed
        packed.flush()
        del packed


@contextlib.contextmanager
def described(
    path: Path,
    shape: tuple[int, ...],
    width: int,
    sensor: SensorLike | None,
    provenance: Provenance | None,
) -> Iterator[Path]:
    """Give a temporary path for a cube; it and all that describes it appear when the block ends."""
    beside = description_path(path)
    maps = {} if sensor is None else sensor.maps()
    map_paths = {name: beside.with_suffix(f".{name}.npy") for name in maps}
    former = maps_in_description(beside)
    foreign = [beside] if beside.is_file() and read_own_description(beside) is None else []
    foreign += [path for path in map_paths.values() if path.is_file() and path not in former]
    if foreign:
        raise FileExistsError(
            f"{foreign[0]} stands where a file that goes with {path.name} would be written, and "
            "jotlight did not write it for these bits; move it, or choose another name"
        )
    description = {**describe(width, sensor, provenance), "shape": list(shape)}
    with contextlib.ExitStack() as stack:
        # What is entered first is put in place last: the bits once all that describes them stands.
        cube = stack.enter_context(atomic_write(path))
        text = stack.enter_context(atomic_write(beside))
        for name, map_ in maps.items():
            with stack.enter_context(atomic_write(map_paths[name])).open("wb") as file:
                np.save(file, map_)
            description["maps"][name] = map_paths[name].name
        text.write_text(json.dumps(description, indent=2) + "\n")
        yield cube
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
