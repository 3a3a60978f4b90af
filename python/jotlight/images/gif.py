"""Animations in GIF, written image by image, so a film of any length needs little memory."""

import contextlib
import io
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from jotlight.array_types import FloatImage
from jotlight.images.color import check_sides
from jotlight.output_files import open_output

MAX_FPS = 50
"""Maximum images per second. Viewers show faster animations more slowly."""

_MAX_SIDE = 65_535
"""Maximum number of rows and columns, which the file states in 16 bits."""

_HEADER = 13
"""Bytes before the color table: the signature and the size of the image."""


@contextlib.contextmanager
def gif_writer(path: Path, fps: float) -> Iterator[Callable[[FloatImage], None]]:
    """Yield a function that adds an image (H, W) or (H, W, 3), in [0, 1], to an animation.

    Each image has its own table of 256 levels or colors. The animation repeats for ever.

    Raises
    ------
    OSError
        If a write fails.
    ValueError
        If an image is too large for the format.
    """
    with open_output(path) as file:
        number = 0

        def add(image: FloatImage) -> None:
            nonlocal number
            check_sides(image, ".gif", _MAX_SIDE)
            still = _encode(image)
            if number == 0:
                # No color table for all images. Then the extension that repeats the animation.
                file.write(still[:10] + b"\0\0\0" + b"!\xff\x0bNETSCAPE2.0\x03\x01\0\0\0")
            # Times are hundredths of a second. Rounding each end keeps the mean rate.
            start, end = (round(100 * index / fps) for index in (number, number + 1))
            file.write(b"!\xf9\x04\0" + (end - start).to_bytes(2, "little") + b"\0\0")
            file.write(_with_own_colors(still))
            number += 1

        yield add
        file.write(b";")


def _encode(image: FloatImage) -> bytes:
    """Return a GIF of one image."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(np.rint(image * 255).astype(np.uint8)).save(buffer, "GIF")
    return buffer.getvalue()


def _with_own_colors(still: bytes) -> bytes:
    """Return the image of a GIF of one image, with its color table between its head and data."""
    bits = still[10] & 7
    end = _HEADER + (2 << bits) * 3
    start = end
    while still[start] == ord("!"):  # an extension: two bytes, and blocks with their lengths
        start += 2
        while still[start]:
            start += 1 + still[start]
        start += 1
    head, data = still[start : start + 9], still[start + 10 : -1]
    flags = 0x80 | (still[start + 9] & 0x40) | bits
    return head + bytes([flags]) + still[_HEADER:end] + data
