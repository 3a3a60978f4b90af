"""Photon cubes: packed bits in a `.npy`, with a description next to it."""

import contextlib
from pathlib import Path
from typing import IO

import numpy as np
import numpy.typing as npt

from jotlight.formats.frames.labels import make_bits_label
from jotlight.formats.frames.packing import check_packed
from jotlight.formats.npy.description import (
    Description,
    check_shape,
    read_bits_description,
    write_described,
)
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import refuse_many_channels
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.provenance import Provenance


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
        refuse_many_channels(str(path), packed.shape)
        if check:
            check_packed(packed, str(path))
        provenance = provenance.with_notes(
            "read as bits, the most significant first, along the width"
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


def describe_bits(bits: Bits, path: Path) -> contextlib.AbstractContextManager[IO[bytes]]:
    """Return a context that yields a file for packed bits.

    The cube, its description, and its maps appear when the context ends. See
    :func:`jotlight.formats.npy.description.write_described`.
    """
    content = {
        **make_bits_label(bits.width, bits.sensor, bits.provenance),
        "shape": list(bits.packed.shape),
    }
    return write_described(path, content, {} if bits.sensor is None else bits.sensor.maps())
