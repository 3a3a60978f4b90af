"""Images in PNG: what Pillow does not check, read, or write."""

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from jotlight.formats.images.png_chunks import SIGNATURE, PngHeader, check_png
from jotlight.formats.images.png_notes import KEYWORD
from jotlight.images.color import drop_transparency, warn_about_transparent_pixels
from jotlight.output_files import OutputFile


def checked_png(stream: BinaryIO) -> PngHeader | None:
    """Return the header of a PNG after checking all of its bytes, or None for other files.

    Some programs append data to a photograph. It is accepted, because the PNG itself is complete.
    """
    is_png = stream.read(len(SIGNATURE)) == SIGNATURE
    stream.seek(0)
    header = check_png(stream.read(), trailing=True) if is_png else None
    stream.seek(0)
    return header


def read_png16(path: Path, stream: BinaryIO) -> npt.NDArray[np.uint16]:
    """Return a 16-bit PNG with transparency or color, which Pillow reduces to 8 bits."""
    import png

    stream.seek(0)
    width, height, rows, info = png.Reader(file=stream).read()
    values = np.array([np.asarray(row, np.uint16) for row in rows])
    values = values.reshape(height, width, info["planes"])
    if info["alpha"]:
        values = drop_transparency(path, values)
    elif (color := info.get("transparent")) is not None:
        warn_about_transparent_pixels(path, (values != color).any(axis=2))
    return values[..., 0] if values.shape[2] == 1 else values


def write_png16(
    file: OutputFile, values: npt.NDArray[np.uint16], note: Mapping[str, Any] | None
) -> None:
    """Write levels of 16 bits, (H, W) or (H, W, 3), with a note. Pillow has no 16-bit color."""
    import png

    rows = values.reshape(len(values), -1)
    stream = io.BytesIO()
    png.from_array(rows, "L;16" if values.ndim == 2 else "RGB;16").write(stream)
    header, *chunks = png.Reader(bytes=stream.getvalue()).chunks()
    text = [(b"tEXt", f"{KEYWORD}\0{json.dumps(dict(note))}".encode())] if note else []
    png.write_chunks(file, [header, *text, *chunks])
