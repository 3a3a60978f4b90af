"""Strips and tiles of a TIFF file, checked before a library decodes them as a whole."""

import lzma
import math
import zlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from jotlight.formats.files.limits import check_frame_size

_STREAMS: dict[int, Callable[[], Any]] = {
    8: zlib.decompressobj,
    32946: zlib.decompressobj,
    34925: lambda: lzma.LZMADecompressor(memlimit=1 << 28),
}
"""Decompressors of Python by TIFF's number of the compression. tifffile sets no limit for them."""

_SMALL_BYTES = 1 << 12
"""Maximum size of a segment that is not checked, because it decodes into less than 64 MiB."""

_PACKBITS = 32773

_MAX_PACKBITS_BYTES = 1 << 22
"""Maximum size of a decoded PackBits segment. tifffile takes 13 times this memory to decode it."""


def check_segments(file: Any, page: Any) -> None:
    """Raise ValueError if a strip or tile of a page is missing, or decodes into too many bytes.

    A tile may be much larger than its image.

    Parameters
    ----------
    file : TiffFile
        The file of tifffile.
    page : TiffPage or TiffFrame
        One of its pages.
    """
    keyframe = page.keyframe
    expected = int(np.prod(keyframe.chunks, dtype=np.int64)) * max(1, keyframe.dtype.itemsize)
    number, places = math.prod(keyframe.chunked), (*page.dataoffsets, *page.databytecounts)
    if len(page.dataoffsets) != number or len(page.databytecounts) != number or not all(places):
        # tifffile reads zeros instead.
        raise ValueError(
            f"expected offsets and sizes of {number} strips or tiles, got {len(page.dataoffsets)} "
            f"and {len(page.databytecounts)}, of which {places.count(0)} are 0; it is damaged or "
            "incomplete"
        )
    check_frame_size("a strip or tile", expected, file.filehandle.size)
    # Compression makes random data a little longer.
    max_stored = 2 * expected + _SMALL_BYTES
    compression = int(keyframe.compression)
    if compression == _PACKBITS and expected > _MAX_PACKBITS_BYTES:
        raise ValueError(
            f"expected PackBits strips or tiles of at most {_MAX_PACKBITS_BYTES} bytes, got "
            f"{expected}; save it uncompressed or in smaller strips"
        )
    for offset, stored in zip(page.dataoffsets, page.databytecounts, strict=True):
        if stored > max_stored and compression != 1:
            raise ValueError(
                f"expected a strip or tile of at most {max_stored} bytes, got {stored}"
            )
        if compression not in (*_STREAMS, _PACKBITS) or stored <= _SMALL_BYTES:
            continue
        file.filehandle.seek(offset)
        size = 0
        for part in _decoded_sizes(compression, file.filehandle.read(stored)):
            size += part
            if size > expected:
                raise ValueError(f"a strip or tile has more than the expected {expected} bytes")


def _decoded_sizes(compression: int, data: bytes) -> Iterator[int]:
    """Yield the sizes of the parts into which a segment decodes, in little memory."""
    if compression == _PACKBITS:
        position = 0
        while position < len(data):
            code = data[position]
            # Codes above 128 repeat one byte, codes below precede different bytes.
            yield 257 - code if code > 128 else (code + 1) % 129
            position += 2 if code > 128 else 1 + (code + 1) % 129
        return
    stream = _STREAMS[compression]()
    while not stream.eof and (data or not getattr(stream, "needs_input", True)):
        yield len(stream.decompress(data, max_length=1 << 20))
        data = getattr(stream, "unconsumed_tail", b"")
