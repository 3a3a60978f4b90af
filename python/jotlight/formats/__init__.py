"""Camera data, one file per family."""

import os
from pathlib import Path

from jotlight.bits import Bits
from jotlight.formats.npy import load_bits


def open(path: str | os.PathLike[str], *, width: int | None = None) -> Bits:
    """Open a capture as :class:`jotlight.Bits`, memory-mapped.

    Parameters
    ----------
    path : path
        A photon cube `.npy`: uint8 (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C).
    width : int, optional
        The true width in jots, where the file does not tell.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When it is not of a known format, truncated, or holds Python objects, which are never read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "cube.npy"
    >>> np.save(path, np.packbits(np.ones((4, 6, 16), bool), axis=2))
    >>> open(path)
    <Bits: 4 frames of 6 x 16 jots>
    """
    path = Path(path)
    if path.suffix.lower() != ".npy":
        raise ValueError(
            f"{path}: expected a photon cube (.npy), got a {path.suffix or 'nameless'} file"
        )
    return load_bits(path, width=width)
