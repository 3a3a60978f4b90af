"""Checks of a whole PNG: its chunks, their checksums, and its compressed levels.

The libraries that read PNG stop when they have the levels, so they miss some damage.
"""

import dataclasses
import zlib
from collections.abc import Iterator

from jotlight.formats.files.limits import check_claimed_size

SIGNATURE = b"\x89PNG\r\n\x1a\n"
"""First bytes of a PNG."""

HEADER_BYTES = len(SIGNATURE) + 8 + 13
"""Number of bytes up to the end of the data of the first chunk, the header."""

GRAYSCALE, PALETTE = 0, 3
"""Color types of images with one level per pixel. Levels of a palette have assigned colors."""

_CHANNELS = {GRAYSCALE: 1, 2: 3, PALETTE: 1, 4: 2, 6: 4}
"""Number of channels for each color type."""

_ADAM7 = ((0, 8, 0, 8), (0, 8, 4, 8), (4, 8, 0, 4), (0, 4, 2, 4), (2, 4, 0, 2), (0, 2, 1, 2),
          (1, 2, 0, 1))  # fmt: skip
"""First row, row step, first column, and column step of the passes of an interlaced image."""

_STEP_BYTES = 1 << 16
"""Maximum number of bytes that are decompressed at a time."""


@dataclasses.dataclass(frozen=True)
class PngHeader:
    """The header of a PNG."""

    width: int
    height: int
    depth: int
    """Bits per channel."""
    color_type: int
    interlaced: bool

    def data_bytes(self) -> int:
        """Return the number of decompressed bytes: for each row, a filter type and its levels."""
        passes = _ADAM7 if self.interlaced else ((0, 1, 0, 1),)
        total = 0
        for row, row_step, column, column_step in passes:
            rows = len(range(row, self.height, row_step))
            columns = len(range(column, self.width, column_step))
            bits = columns * _CHANNELS[self.color_type] * self.depth
            total += rows * (1 + -(-bits // 8)) if columns else 0
        return total

    def decoded_bytes(self) -> int:
        """Return the number of bytes of the image in memory, where a level has 8 or 16 bits."""
        channels = _CHANNELS[self.color_type]
        return self.width * self.height * channels * max(1, self.depth // 8)


def check_png(content: bytes, *, trailing: bool = False) -> PngHeader:
    """Return the header of a PNG after checking all of its bytes.

    Parameters
    ----------
    content : bytes
        The whole file.
    trailing : bool
        Whether other bytes may follow the PNG. Some programs append data to photographs.

    Raises
    ------
    ValueError
        When a chunk is damaged or missing, or the compressed levels are incomplete, do not fit
        their checksum, or have another size than the header states. When the image is much larger
        than the file, see :func:`jotlight.formats.files.limits.check_frame_size`.

    Examples
    --------
    >>> import io
    >>> from PIL import Image
    >>> file = io.BytesIO()
    >>> Image.new("L", (3, 2)).save(file, "PNG")
    >>> check_png(file.getvalue())
    PngHeader(width=3, height=2, depth=8, color_type=0, interlaced=False)
    >>> check_png(file.getvalue() + b"more")
    Traceback (most recent call last):
    ...
    ValueError: expected nothing after its last chunk, got 4 bytes
    """
    if not content.startswith(SIGNATURE):
        raise ValueError("it does not begin like a PNG")
    header, levels, end = None, [], 0
    for kind, start, end in _read_chunks(content):
        if header is None:
            header = _read_header(kind, content[start:end])
        if kind == b"IDAT":
            levels.append(memoryview(content)[start:end])
    end += 4
    if end < len(content) and not trailing:
        raise ValueError(f"expected nothing after its last chunk, got {len(content) - end} bytes")
    if header is None:
        raise ValueError("it has no header")
    size = header.decoded_bytes()
    check_claimed_size("the header", size, len(content), frame_bytes=size)
    _check_levels(levels, header.data_bytes())
    return header


def read_png_header(beginning: bytes) -> PngHeader:
    """Return the header from the first :data:`HEADER_BYTES` bytes of a PNG.

    Raises
    ------
    ValueError
        When the header is damaged.
    """
    if not beginning.startswith(SIGNATURE):
        raise ValueError("it does not begin like a PNG")
    start = len(SIGNATURE) + 8
    return _read_header(beginning[start - 4 : start], beginning[start:HEADER_BYTES])


def _read_chunks(content: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Yield the type of each chunk and the start and end of its data, if its checksum matches."""
    kind, position = b"", len(SIGNATURE)
    while kind != b"IEND":
        start = position + 8
        end = start + int.from_bytes(content[position : position + 4], "big")
        kind = content[position + 4 : start]
        if end + 4 > len(content):
            raise ValueError("it is truncated, or the length of a chunk is damaged")
        checksum = zlib.crc32(memoryview(content)[position + 4 : end])
        if checksum != int.from_bytes(content[end : end + 4], "big"):
            raise ValueError(f"its chunk {kind!r} does not fit its checksum")
        yield kind, start, end
        position = end + 4


def _read_header(kind: bytes, data: bytes) -> PngHeader:
    if kind != b"IHDR" or len(data) != 13:
        raise ValueError(f"expected a header as its first chunk, got {kind!r}")
    depth, color_type, compression, filters, interlaced = data[8:]
    if color_type not in _CHANNELS or depth not in (1, 2, 4, 8, 16):
        raise ValueError(f"its header has depth {depth} and color type {color_type}")
    if (compression, filters) != (0, 0) or interlaced > 1:
        raise ValueError("its header names an unknown compression, filter, or interlacing")
    return PngHeader(
        int.from_bytes(data[:4], "big"),
        int.from_bytes(data[4:8], "big"),
        depth,
        color_type,
        bool(interlaced),
    )


def _check_levels(parts: list[memoryview], expected: int) -> None:
    """Decompress levels to their end, where zlib checks their Adler-32, in little memory."""
    stream, got = zlib.decompressobj(), 0
    try:
        for part in parts:
            data: bytes | memoryview = part
            while data and not stream.eof and got <= expected:
                got += len(stream.decompress(data, _STEP_BYTES))
                data = stream.unconsumed_tail
            if stream.eof and (data or stream.unused_data):
                raise ValueError("expected nothing after its compressed levels, got more bytes")
    except zlib.error as error:
        raise ValueError(f"its compressed levels are damaged ({error})") from error
    if got != expected or not stream.eof:
        raise ValueError(f"expected compressed levels of {expected} bytes, got {got} or more")
