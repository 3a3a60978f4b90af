"""Compressed strips and tiles of a TIFF file, checked before a library decodes them as a whole."""

import lzma
import math
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

_STREAMS: dict[int, Callable[[], Any]] = {
    8: zlib.decompressobj,
    32946: zlib.decompressobj,
    34925: lambda: lzma.LZMADecompressor(memlimit=1 << 28),
}
"""Decompressors of Python by TIFF's number of the compression. tifffile sets no limit for them."""

_SMALL_BYTES = 1 << 12
"""Maximum size of a segment that is not checked, because it decodes into less than 64 MiB."""


def check_segments(file: Any, page: Any) -> None:
    """Raise ValueError if strips or tiles of a page are missing, or one decodes into too many bytes.

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
    # Compression makes random data a little longer.
    max_stored = 2 * expected + _SMALL_BYTES
    for offset, stored in zip(page.dataoffsets, page.databytecounts, strict=True):
        if stored > max_stored and int(keyframe.compression) != 1:
            raise ValueError(
                f"expected a strip or tile of at most {max_stored} bytes, got {stored}"
            )
        if int(keyframe.compression) not in _STREAMS or stored <= _SMALL_BYTES:
            continue
        file.filehandle.seek(offset)
        stream, data, size = _STREAMS[int(keyframe.compression)](), file.filehandle.read(stored), 0
        while data or not getattr(stream, "needs_input", True):
            size += len(stream.decompress(data, max_length=1 << 20))
            data = getattr(stream, "unconsumed_tail", b"")
            if size > expected:
                raise ValueError(f"a strip or tile has more than the expected {expected} bytes")
            if stream.eof:
                break
