"""Photon cubes: packed bits in a `.npy`, with a description next to it."""

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.files import atomic_write, flush_to_disk, write_file
from jotlight.formats.arrays import write_npy
from jotlight.formats.description import (
    description_path,
    map_path,
    maps_in_description,
    read_description,
    read_own_description,
)
from jotlight.formats.labels import make_bits_label
from jotlight.formats.packing import check_packed
from jotlight.output_files import open_output
from jotlight.sensing.bits import Bits, SensorLike
from jotlight.sensing.frames import Frames
from jotlight.sensing.provenance import Provenance


def open_cube(
    packed: npt.NDArray[np.uint8] | Frames,
    path: Path,
    format_: str,
    width: int | None,
    *,
    check: bool = True,
) -> Bits:
    """Return the bits of a cube, with the metadata from the description next to it.

    Parameters
    ----------
    packed : ndarray of uint8 or Frames, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
    path : path
        The file of the cube.
    format_ : str
        Name of the format, for the provenance.
    width : int, optional
        True width in jots. Default: the width in the description, or else a multiple of 8.
    check : bool
        Whether frames without a description are refused if they look unpacked.

    Raises
    ------
    OSError, ValueError
        When the description is invalid, or the width or the frames do not fit.
    """
    stated_width, sensor, origin = read_description(path, packed.shape)
    provenance = Provenance(format_, path.name).converted_from(origin)
    if stated_width is None:
        if check:
            check_packed(packed, str(path))
        provenance = provenance.with_notes(
            "taken for bits, the most significant first, along the width"
        )
        if width is None:
            provenance = provenance.with_notes("the width is taken to be a multiple of 8")
    if width is not None and stated_width is not None and width != stated_width:
        raise ValueError(
            f"{path}: the description next to it states a width of {stated_width}, not {width}"
        )
    try:
        return Bits(packed, width if width is not None else stated_width, sensor, provenance)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def write_cube(bits: Bits, path: str | os.PathLike[str]) -> None:
    """Write bits as a cube with its description, completely or not at all."""
    path = Path(path)
    shape = bits.packed.shape
    with (
        describe_cube(path, shape, bits.width, bits.sensor, bits.provenance) as cube,
        open_output(cube) as file,
    ):
        write_npy(file, bits.packed)


@contextlib.contextmanager
def describe_cube(
    path: Path,
    shape: tuple[int, ...],
    width: int,
    sensor: SensorLike | None,
    provenance: Provenance | None,
) -> Iterator[Path]:
    """Yield a temporary path for a cube.

    The cube, its description, and its maps appear when the block ends. The maps of an overwritten
    cube are deleted.

    Parameters
    ----------
    path : path
        The path of the cube.
    shape : tuple of int
        Shape of the packed bits, (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C).
    width : int
        W, the true width in jots.
    sensor : Sensor, optional
        Sensor of the bits.
    provenance : Provenance, optional
        Provenance of the bits.

    Raises
    ------
    FileExistsError
        When a file that jotlight did not write for this cube would be overwritten.
    """
    description = description_path(path)
    maps = {} if sensor is None else sensor.maps()
    map_paths = {name: map_path(description, name) for name in maps}
    replaced_maps = maps_in_description(description)
    _refuse_foreign_files(path, description, set(map_paths.values()) - replaced_maps)
    label = {**make_bits_label(width, sensor, provenance), "shape": list(shape)}
    with contextlib.ExitStack() as stack:
        # The stack renames in reverse order, so the cube appears after its description and maps.
        cube = stack.enter_context(atomic_write(path))
        text = stack.enter_context(atomic_write(description))
        for name, map_ in maps.items():
            with open_output(stack.enter_context(atomic_write(map_paths[name]))) as file:
                np.save(file, map_)
            label["maps"][name] = map_paths[name].name
        write_file(text, json.dumps(label, indent=2) + "\n")
        yield cube
        # If this fails, the old description must still be there.
        flush_to_disk(cube)
    for stale in replaced_maps - set(map_paths.values()):
        stale.unlink(missing_ok=True)


def _refuse_foreign_files(cube: Path, description: Path, new_maps: set[Path]) -> None:
    """Raise FileExistsError if writing a cube would overwrite files of other origin."""
    foreign = []
    if description.is_file() and read_own_description(description) is None:
        foreign.append(description)
    foreign += sorted(path for path in new_maps if path.is_file())
    if foreign:
        raise FileExistsError(
            f"{foreign[0]} would be overwritten by a file that belongs to {cube.name}, but "
            "jotlight did not write it for these bits; move it, or choose another name"
        )
