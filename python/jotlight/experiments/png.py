"""Images as PNG with 8 bits or one bit per pixel."""

import io
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image
from PIL.PngImagePlugin import PngImageFile

from jotlight.formats.images.png_chunks import check_png


def encode_png(image: npt.NDArray[Any]) -> bytes:
    """Return an image in [0, 1] as a PNG with 8 bits, or a boolean array with one bit."""
    levels = image if image.dtype == bool else np.rint(np.clip(image, 0, 1) * 255)
    levels = levels if levels.dtype == bool else levels.astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(levels).save(file, "png", optimize=True)
    return file.getvalue()


def decode_png(file: bytes, name: str) -> npt.NDArray[np.float32]:
    """Return the image in [0, 1] of which :func:`encode_png` made a file.

    Raises
    ------
    ValueError
        If the file is damaged. The message begins with `name`.
    """
    try:
        check_png(file)
        with PngImageFile(io.BytesIO(file)) as image:
            levels = np.asarray(image)
    except Exception as error:  # any type: Pillow does not check everything it reads
        raise ValueError(f"{name}: damaged; delete these results with --restart") from error
    return levels.astype(np.float32) / np.float32(1 if levels.dtype == bool else 255)
