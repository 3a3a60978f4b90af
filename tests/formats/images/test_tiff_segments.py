"""Strips and tiles of TIFF files that are missing, or decode into more than they should."""

import lzma
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from jotlight.images.io import read_image

ZLIB, LZMA, PACKBITS = 8, 34925, 32773


def write_strip(path, strip, compression, width=100, height=60):
    """Write a TIFF file with one strip."""
    tags = [(256, width), (257, height), (258, 8), (259, compression), (262, 1), (273, 110)]
    tags += [(278, height), (279, len(strip))]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    path.write_bytes(b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4) + strip)


def read_one_image(path):
    return read_image(path, white=1)


@pytest.mark.parametrize(
    ("read", "compression", "size"),
    [
        *((read, kind, 6001) for read in (jl.open, read_one_image) for kind in (ZLIB, LZMA)),
        (jl.open, ZLIB, 1 << 25),
        (read_one_image, LZMA, 1 << 25),
        pytest.param(jl.open, LZMA, 1 << 25, marks=pytest.mark.slow),
        pytest.param(read_one_image, ZLIB, 1 << 25, marks=pytest.mark.slow),
    ],
)
def test_a_strip_that_inflates_is_refused(read, compression, size, tmp_path):
    content = np.random.default_rng(0).bytes(4500) + bytes(size - 4500)
    strip = zlib.compress(content) if compression == ZLIB else lzma.compress(content, preset=0)
    write_strip(tmp_path / "a.tif", strip, compression)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=r"a\.tif: .*strip or tile"):
            read(tmp_path / "a.tif")
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


def test_a_strip_that_is_too_long_is_not_decoded(tmp_path):
    write_strip(tmp_path / "a.tif", b"\x81\x00" * 10**5, PACKBITS)
    with pytest.raises(
        ValueError, match=r"a\.tif: .*strip or tile of at most 16096 bytes, got 200000"
    ):
        jl.open(tmp_path / "a.tif")


def tiff_of_one_tile(side):
    """Return a TIFF file of 8 x 8 pixels with one tile, whose content has 16 x 16 of them."""
    tile = zlib.compress(bytes(256))
    tags = [(256, 8), (257, 8), (258, 8), (259, ZLIB), (262, 1), (322, side), (323, side)]
    tags += [(324, 122), (325, len(tile))]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4) + tile


@pytest.mark.parametrize("read", [read_image, jl.open])
def test_a_tile_that_is_much_larger_than_its_image_is_refused(tmp_path, read):
    path = tmp_path / "a.tif"
    path.write_bytes(tiff_of_one_tile(side=16))
    assert np.asarray(read_image(path)).shape == (8, 8)
    path.write_bytes(tiff_of_one_tile(side=32768))
    with pytest.raises(ValueError, match=r"a\.tif: .*strip or tile: .* frames of at most 67108864"):
        read(path)


def test_packbits_strips_that_decode_into_too_much_are_refused(tmp_path):
    write_strip(tmp_path / "a.tif", b"\x81\x00" * 4000, PACKBITS)
    with pytest.raises(ValueError, match=r"a\.tif: .*more than the expected 6000 bytes"):
        jl.open(tmp_path / "a.tif")
    write_strip(tmp_path / "a.tif", b"\x81\x00" * (1 << 16), PACKBITS, 1 << 12, 1 << 11)
    with pytest.raises(ValueError, match=r"a\.tif: .*PackBits strips .* at most 4194304 bytes"):
        jl.open(tmp_path / "a.tif")


@pytest.mark.parametrize("high", [2, 255])
def test_honest_packbits_strips_are_read(tmp_path, high):
    counts = np.random.default_rng(0).integers(0, high, (90, 130), np.uint8)
    Image.fromarray(counts).save(tmp_path / "a.tif", compression="packbits")
    np.testing.assert_array_equal(jl.open(tmp_path / "a.tif"), counts)


def test_a_packbits_code_that_stands_for_nothing_is_read(tmp_path):
    write_strip(tmp_path / "a.tif", b"\x80" * 4097 + b"\xff\x05\x03abcd" * 1000, PACKBITS)
    assert jl.open(tmp_path / "a.tif").astype(np.uint8).tobytes() == b"\5\5abcd" * 1000


@pytest.mark.parametrize("compression", ["zlib", "lzma"])
@pytest.mark.parametrize("tile", [None, (32, 16)])
@pytest.mark.parametrize("shape", [(3, 90, 130), (90, 130, 3)])
def test_honest_strips_and_tiles_are_read(tmp_path, compression, tile, shape):
    counts = np.random.default_rng(0).integers(0, 60000, shape, np.uint16)
    photometric = "rgb" if shape[-1] == 3 else "minisblack"
    tifffile.imwrite(
        tmp_path / "a.tif", counts, compression=compression, tile=tile, photometric=photometric
    )
    expected = counts if photometric == "rgb" else counts.sum(0, dtype=np.int32)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.tif", frames=slice(0, 9)), expected)


def counts_in_tiles(path, change):
    """Write counts in 16 tiles, and change the list of offsets or of sizes."""
    counts = np.random.default_rng(0).integers(1, 255, (64, 64), np.uint8)
    tifffile.imwrite(path, counts, tile=(16, 16), compression="zlib", photometric="minisblack")
    tag, field, value = change
    with tifffile.TiffFile(path) as file:
        place = file.pages[0].tags[tag]
    content = bytearray(path.read_bytes())
    position = place.offset + 4 if field == "number" else place.valueoffset
    content[position : position + 4] = value.to_bytes(4, "little")  # one offset or two sizes
    path.write_bytes(content)


OFFSETS, SIZES = 324, 325


@pytest.mark.parametrize("read", [jl.open, lambda path: read_image(path, white=1)])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((OFFSETS, "number", 15), "16 strips or tiles, got 15 and 16, of which 0 are 0"),
        ((OFFSETS, "number", 1), "16 strips or tiles, got 1 and 16"),
        ((SIZES, "number", 15), "16 strips or tiles, got 16 and 15"),
        ((OFFSETS, "value", 0), "16 strips or tiles, got 16 and 16, of which 1 are 0"),
        ((SIZES, "value", 0), "16 strips or tiles, got 16 and 16, of which 2 are 0"),
    ],
)
def test_missing_tiles_are_refused(read, change, message, tmp_path):
    counts_in_tiles(tmp_path / "a.tif", change)
    with pytest.raises(ValueError, match=rf"a\.tif: .*expected offsets and sizes of {message}"):
        read(tmp_path / "a.tif")
