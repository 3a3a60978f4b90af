"""Photon cubes: packed bits in a `.npy`, with a description next to it."""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.formats.description import (
    Description,
    check_shape,
    read_bits_description,
    write_described,
)
from jotlight.formats.labels import make_bits_label
from jotlight.formats.packing import check_packed
from jotlight.memory_maps import release
from jotlight.sensing.bits import Bits, SensorLike
from jotlight.sensing.frames import Frames, read_in_chunks
from jotlight.sensing.provenance import Provenance


def open_cube(
    packed: npt.NDArray[np.uint8] | Frames,
    path: Path,
    format_: str,
    width: int | None,
    description: Description | None = None,
    *,
    check: bool = True,
) -> Bits:
    """Return the bits of a cube, with the metadata from its description.

    Parameters
    ----------
    packed : ndarray of uint8 or Frames, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
    path : path
        The file of the cube.
    format_ : str
        Name of the format, for the provenance.
    width : int, optional
        True width in jots. Default: the width in the description, or else a multiple of 8.
    description : Description, optional
        The description next to the cube.
    check : bool
        Whether frames without a description are refused if they look unpacked.

    Raises
    ------
    OSError, ValueError
        When the description is invalid, or the width or the frames do not fit.
    """
    stated_width, sensor, provenance = None, None, Provenance(format_, path.name)
    if description is not None:
        check_shape(description, path, packed.shape)
        stated_width, sensor, origin = read_bits_description(description)
        provenance = provenance.converted_from(origin)
    else:
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
    shape = bits.packed.shape
    with create_bits(path, shape, bits.width, bits.sensor, bits.provenance) as packed:
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
    """Yield a memory map for packed bits. The cube appears when the block ends.

    Parameters
    ----------
    path : path
        The path of the cube, which ends in `.npy`.
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
    OSError
        When the files cannot be written.
    ValueError
        When the path has another extension.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "cube.npy"
    >>> with create_bits(path, shape=(2, 3, 1), width=5, sensor=None) as packed:
    ...     packed[:] = 255
    >>> sorted(file.name for file in path.parent.iterdir())
    ['cube.json', 'cube.npy']
    """
    path = Path(path)
    if path.suffix != ".npy":
        raise ValueError(f"{path}: expected a name that ends in .npy for packed bits")
    with describe_cube(path, shape, width, sensor, provenance) as cube:
        packed = np.lib.format.open_memmap(cube, mode="w+", dtype=np.uint8, shape=shape)
        # On a full disk, writing to a memory map without allocated blocks would kill the process.
        _allocate(cube)
        yield packed
        packed.flush()
        del packed


@contextlib.contextmanager
def describe_cube(
    path: Path,
    shape: tuple[int, ...],
    width: int,
    sensor: SensorLike | None,
    provenance: Provenance | None,
) -> Iterator[Path]:
    """Yield a temporary path for a cube, which appears with its description when the block ends.

    See :func:`create_bits` for the parameters.

    Raises
    ------
    FileExistsError
        When a file that jotlight did not write for this cube would be overwritten.
    """
    content = {**make_bits_label(width, sensor, provenance), "shape": list(shape)}
    with write_described(path, content, {} if sensor is None else sensor.maps()) as cube:
        yield cube


def _allocate(path: Path) -> None:
    """Allocate all blocks of a file on disk, if the operating system supports it."""
    if not hasattr(os, "posix_fallocate"):
        return
    try:
        with path.open("r+b") as file:
            os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
    except OSError as error:
        if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL):
            raise
