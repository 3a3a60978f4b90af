"""Rotation of packed frames by multiples of 90 degrees, and mirroring, without unpacking them."""

from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Packed
from jotlight.sensing.bits.frames import Frames, read_in_chunks

FLIPS = ("horizontal", "vertical")
"""Names of the mirrorings: left and right are exchanged, or top and bottom."""

_CHUNK_BYTES = 1 << 20
"""Number of bytes that are rotated at once. They fit into the cache."""


def parse_orientation(rotate: int, flip: str | None) -> int:
    """Return the number of quarter turns counterclockwise, 0 to 3, for an angle in degrees.

    Raises
    ------
    ValueError
        When the angle is not a multiple of 90, or `flip` is unknown.

    Examples
    --------
    >>> parse_orientation(-90, None)
    3
    """
    if isinstance(rotate, bool) or not isinstance(rotate, int | np.integer) or rotate % 90:
        raise ValueError(
            f"rotate: expected a multiple of 90 degrees, counterclockwise, got {rotate!r}"
        )
    if flip is not None and flip not in FLIPS:
        raise ValueError(f"flip: expected {' or '.join(FLIPS)}, got {flip!r}")
    return int(rotate) // 90 % 4


def orient_image(image: npt.NDArray[Any], quarters: int, flip: str | None) -> npt.NDArray[Any]:
    """Return an image (H, W) or (H, W, C), rotated counterclockwise and then mirrored.

    Examples
    --------
    >>> orient_image(np.array([[1, 2]]), 1, None).tolist()
    [[2], [1]]
    """
    image = np.rot90(image, quarters)
    if flip is not None:
        image = image[:, ::-1] if flip == "horizontal" else image[::-1]
    return np.ascontiguousarray(image)


def orient_packed(
    packed: Packed | Frames, width: int, quarters: int, flip: str | None
) -> tuple[Packed | Frames, int]:
    """Return packed frames, rotated counterclockwise and then mirrored, and their new width.

    Parameters
    ----------
    packed : ndarray of uint8 or Frames, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
        The frames are rotated when they are read.
    width : int
        W.
    quarters : int
        Quarter turns counterclockwise, 0 to 3.
    flip : {"horizontal", "vertical"}, optional
    """
    if quarters == 0 and flip is None:
        return packed, width
    frames, height, _, *channels = packed.shape
    new_height, new_width = (width, height) if quarters % 2 else (height, width)
    shape = (frames, new_height, (new_width + 7) // 8, *channels)

    def read(start: int, stop: int) -> Packed:
        oriented = np.empty((stop - start, *shape[1:]), np.uint8)
        for place, part in read_in_chunks(packed[start:stop], _CHUNK_BYTES):
            if not channels:
                oriented[place] = _orient(part, width, quarters, flip)
            for channel in range(part.shape[3] if channels else 0):
                oriented[place, ..., channel] = _orient(part[..., channel], width, quarters, flip)
        return oriented

    return Frames(shape, read), new_width


def _orient(part: Packed, width: int, quarters: int, flip: str | None) -> Packed:
    # All eight orientations are sequences of transposing the frames and of reversing the order of
    # their rows, which is cheap.
    height = part.shape[1]
    if quarters == 1:
        part = rotate_packed(part, width)
    elif quarters == 2:
        part = _mirror(part[:, ::-1], width)
    elif quarters == 3:
        part = transpose_packed(part[:, ::-1], width)
    if flip == "vertical":
        part = part[:, ::-1]
    elif flip == "horizontal":
        part = _mirror(part, height if quarters % 2 else width)
    return part


def _mirror(part: Packed, width: int) -> Packed:
    """Return packed frames with left and right exchanged."""
    return transpose_packed(transpose_packed(part, width)[:, ::-1], part.shape[1])


def transpose_packed(part: Packed, width: int) -> Packed:
    """Return packed frames (T, H, ceil(W / 8)), transposed: (T, W, ceil(H / 8)).

    Examples
    --------
    >>> transpose_packed(np.array([[[0b10100000]]], np.uint8), 3)[0, :, 0].tolist()
    [128, 0, 128]
    """
    transposed = _empty_transposed(part, width)
    engine.transpose_bits(part, width, transposed, None)
    return transposed


def rotate_packed(part: Packed, width: int) -> Packed:
    """Return packed frames (T, H, ceil(W / 8)), rotated counterclockwise: (T, W, ceil(H / 8)).

    Examples
    --------
    >>> rotate_packed(np.array([[[0b11000000]]], np.uint8), 3)[0, :, 0].tolist()
    [0, 128, 128]
    """
    rotated = _empty_transposed(part, width)
    engine.transpose_bits(part, width, rotated[:, ::-1], None)
    return rotated


def _empty_transposed(part: Packed, width: int) -> Packed:
    frames, height, _ = part.shape
    return np.empty((frames, width, (height + 7) // 8), np.uint8)
