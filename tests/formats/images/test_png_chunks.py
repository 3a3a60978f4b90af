"""Checks of a whole PNG."""

import functools
import io
import zlib

import numpy as np
import png
import pytest
from PIL import Image

import jotlight as jl
from examples.encodings import with_png_checksums
from jotlight.formats.images.maps import read_mask
from jotlight.formats.images.png_chunks import check_png
from jotlight.images.io import read_image

RNG = np.random.default_rng(0)


def png_bytes(writer):
    """Return a PNG of random levels that a writer of pypng makes."""
    file = io.BytesIO()
    rows = RNG.integers(0, 2**writer.bitdepth, (writer.height, writer.width * writer.planes))
    writer.write(file, rows.tolist())
    return file.getvalue()


def chunk(kind, data):
    return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")


def split(content):
    """Return the bytes of a PNG before its levels, the compressed levels, and those after them."""
    start = content.index(b"IDAT") - 4
    size = int.from_bytes(content[start : start + 4], "big")
    return content[:start], content[start + 8 : start + 8 + size], content[start + 12 + size :]


WRITERS = (
    *(functools.partial(png.Writer, greyscale=True, bitdepth=depth) for depth in (1, 2, 4, 8, 16)),
    functools.partial(png.Writer, greyscale=False, bitdepth=16),
    functools.partial(png.Writer, greyscale=False, alpha=True, bitdepth=16),
    functools.partial(png.Writer, greyscale=True, alpha=True),
    functools.partial(png.Writer, palette=[(0, 0, 0), (9, 9, 9)], bitdepth=1),
)
"""Writers of every kind of PNG."""


@pytest.mark.parametrize("interlace", [False, True])
@pytest.mark.parametrize("writer", WRITERS)
def test_every_kind_of_png_is_accepted(writer, interlace):
    for width, height in [(1, 1), (1, 9), (3, 2), (13, 7), (64, 33)]:
        content = png_bytes(writer(width, height, interlace=interlace))
        header = check_png(content)
        assert (header.width, header.height) == (width, height)
        assert header.data_bytes() == len(zlib.decompress(split(content)[1]))


def test_levels_in_many_chunks_are_one_stream():
    before, levels, after = split(png_bytes(png.Writer(64, 33, greyscale=True)))
    parts = [chunk(b"IDAT", levels[place : place + 100]) for place in range(0, len(levels), 100)]
    check_png(before + b"".join(parts) + after)
    with pytest.raises(ValueError, match="compressed levels"):
        check_png(before + b"".join(parts[:-1]) + after)


WHOLE = png_bytes(png.Writer(13, 7, greyscale=True))
BEFORE, LEVELS, AFTER = split(WHOLE)
RAW = zlib.decompress(LEVELS)


def with_levels(levels):
    """Return a PNG with these compressed levels in one chunk."""
    return BEFORE + chunk(b"IDAT", levels) + AFTER


DAMAGED = {
    "wrong Adler-32": with_levels(LEVELS[:-1] + bytes([LEVELS[-1] ^ 1])),
    "no Adler-32": with_levels(LEVELS[:-4]),
    "more after the levels": with_levels(LEVELS + b"\0"),
    "too few levels": with_levels(zlib.compress(RAW[:-1])),
    "too many levels": with_levels(zlib.compress(RAW + b"\0")),
    "a bomb": with_levels(zlib.compress(RAW + bytes(10**6))),
    "no end": BEFORE + chunk(b"IDAT", LEVELS),
    "no levels": BEFORE + AFTER,
    "no header": WHOLE[:8] + chunk(b"IDAT", LEVELS) + AFTER,
    "truncated": WHOLE[:-1],
    "only a signature": WHOLE[:8],
    "unknown color type": with_png_checksums(WHOLE[:25] + b"\5" + WHOLE[26:]),
    "unknown interlacing": with_png_checksums(WHOLE[:28] + b"\2" + WHOLE[29:]),
}
"""PNG files with valid chunks but another damage."""


@pytest.mark.filterwarnings("ignore:.*marks .* of the jots as dead")
@pytest.mark.parametrize("kind", DAMAGED)
def test_a_png_with_damage_is_refused_as_capture_mask_and_image(tmp_path, kind):
    path = tmp_path / "a.png"
    path.write_bytes(WHOLE)
    for read in (jl.open, read_mask, read_image):
        read(path)
    path.write_bytes(DAMAGED[kind])
    for read in (jl.open, read_mask, read_image):
        with pytest.raises(ValueError, match=r"a\.png"):
            read(path)


def test_only_an_image_may_be_followed_by_other_data(tmp_path):
    path, levels = tmp_path / "a.png", RNG.integers(0, 256, (5, 6), np.uint8)
    Image.fromarray(levels).save(path)
    path.write_bytes(path.read_bytes() + b"data of a camera")
    np.testing.assert_allclose(read_image(path) * 255, levels, atol=1e-4)
    for read in (jl.open, read_mask):
        with pytest.raises(ValueError, match=r"a\.png.*expected nothing after its last chunk"):
            read(path)
