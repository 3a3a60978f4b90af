"""Frames turned by quarters and mirrored while they stay packed."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.sensing.frames import Frames, read_in_chunks

FLIPS = ("horizontal", "vertical")

_AT_ONCE = 1 << 20
"""Bytes that are turned at once, so that they stay in the cache."""

Packed = npt.NDArray[np.uint8]


def parse_orientation(rotate: int, flip: str | None) -> int:
    """Give the quarter turns of an angle in degrees, 0 to 3, or raise ValueError."""
    if isinstance(rotate, bool) or not isinstance(rotate, int | np.integer) or rotate % 90:
        raise ValueError(
            f"rotate: expected a multiple of 90 degrees, anticlockwise, got {rotate!r}"
        )
    if flip is not None and flip not in FLIPS:
        raise ValueError(f"flip: expected {' or '.join(FLIPS)}, got {flip!r}")
    return int(rotate) // 90 % 4


def orient_image(image: npt.NDArray[Any], quarters: int, flip: str | None) -> npt.NDArray[Any]:
    """An image (H, W) or (H, W, C), turned anticlockwise and then mirrored."""
    image = np.rot90(image, quarters)
    if flip is not None:
        image = image[:, ::-1] if flip == "horizontal" else image[::-1]
    return np.ascontiguousarray(image)


def orient_packed(
    packed: Packed | Frames, width: int, quarters: int, flip: str | None
) -> tuple[Packed | Frames, int]:
    """Packed frames, turned anticlockwise and then mirrored, with their new width.

    They are turned when they are read.
    """
    if quarters == 0 and flip is None:
        return packed, width
    frames, height, _, *channels = packed.shape
    new_height, new_width = (width, height) if quarters % 2 else (height, width)
    shape = (frames, new_height, (new_width + 7) // 8, *channels)

    def read(start: int, stop: int) -> Packed:
        out = np.empty((stop - start, *shape[1:]), np.uint8)
        for place, part in read_in_chunks(packed[start:stop], _AT_ONCE):
            if not channels:
                out[place] = _turned(part, width, quarters, flip)
            for channel in range(part.shape[3] if channels else 0):
                out[place, ..., channel] = _turned(part[..., channel], width, quarters, flip)
        return out

    return Frames(shape, read), new_width


def _turned(part: Packed, width: int, quarters: int, flip: str | None) -> Packed:
    # All eight turns are made of the transpose and of rows in reverse, which packing allows.
    height = part.shape[1]
    if quarters == 1:
        part = transpose_packed(part, width)[:, ::-1]
    elif quarters == 2:
        part = _mirrored(part[:, ::-1], width)
    elif quarters == 3:
        part = transpose_packed(part[:, ::-1], width)
    if flip == "vertical":
        part = part[:, ::-1]
    elif flip == "horizontal":
        part = _mirrored(part, height if quarters % 2 else width)
    return part


def _mirrored(part: Packed, width: int) -> Packed:
    return transpose_packed(transpose_packed(part, width)[:, ::-1], part.shape[1])


def transpose_packed(part: Packed, width: int) -> Packed:
    """Packed frames (T, H, ceil(W / 8)) with rows and columns exchanged: (T, W, ceil(H / 8)).

    Blocks of 8 x 8 bits are words of 64, turned by three exchanges (Warren, Hacker's Delight,
    section 7-3), and then blocks change places.

    Examples
    --------
    >>> transpose_packed(np.array([[[0b10100000]]], np.uint8), 3)[0, :, 0].tolist()
    [128, 0, 128]
    """
    frames, height, row_bytes = part.shape
    blocks = (height + 7) // 8
    rows = np.zeros((frames, blocks, 8, row_bytes), np.uint8)
    rows.reshape(frames, 8 * blocks, row_bytes)[:, :height] = part
    # The first row is the most significant byte, as the first column is the most significant bit.
    words = np.ascontiguousarray(rows.transpose(0, 3, 1, 2)).view(">u8")[..., 0].astype(np.uint64)
    for shift, mask in (
        (7, 0x00AA00AA00AA00AA),
        (14, 0x0000CCCC0000CCCC),
        (28, 0x00000000F0F0F0F0),
    ):
        differ = (words ^ (words >> np.uint64(shift))) & np.uint64(mask)
        words ^= differ ^ (differ << np.uint64(shift))
    columns = words.astype(">u8").view(np.uint8).reshape(frames, row_bytes, blocks, 8)
    return columns.transpose(0, 1, 3, 2).reshape(frames, 8 * row_bytes, blocks)[:, :width]
