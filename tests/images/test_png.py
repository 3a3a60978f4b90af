"""Images in PNG files of 16 bits: their transparency, scale, and orientation."""

import io
import struct
import zlib

import numpy as np
import png
import pytest
from PIL import Image

from jotlight.errors import JotlightWarning
from jotlight.images.io import image_writer, read_image

VALUES = np.random.default_rng(0).integers(0, 65536, (4, 6, 3), dtype=np.uint16)


@pytest.mark.parametrize("image", [VALUES[..., 0] / 65535, VALUES / 65535], ids=["gray", "color"])
def test_a_16_bit_png_holds_all_its_levels(tmp_path, image):
    path = tmp_path / "a.png"
    image_writer(path, depth=16)(path, image)
    _, _, rows, information = png.Reader(bytes=path.read_bytes()).read()
    assert information["bitdepth"] == 16
    levels = np.vstack([np.asarray(row) for row in rows]).reshape(image.shape)
    assert (levels == np.rint(image.astype(np.float64) * 65535)).all()


def test_transparency_of_a_16_bit_png_is_dropped(tmp_path):
    path = tmp_path / "a.png"
    values = np.random.default_rng(0).integers(0, 65536, (4, 5, 4), dtype=np.uint16)
    with path.open("wb") as file:
        writer = png.Writer(5, 4, greyscale=False, alpha=True, bitdepth=16)
        writer.write(file, values.reshape(4, -1))
    with pytest.warns(JotlightWarning, match=r"a\.png: 20 of 20 pixels are transparent"):
        assert np.allclose(read_image(path), values[..., :3] / 65535, atol=1e-6)
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ValueError, match=r"a\.png: the image cannot be read \(it is truncated"):
        read_image(path)


def png16(path, values, *, before_data=b"", **options):
    """Write a 16-bit PNG with more chunks before its data."""
    height, width = values.shape[:2]
    buffer = io.BytesIO()
    png.Writer(width, height, bitdepth=16, **options).write(buffer, values.reshape(height, -1))
    content = buffer.getvalue()
    at = content.index(b"IDAT") - 4
    path.write_bytes(content[:at] + before_data + content[at:])


def chunk(kind, content):
    return (
        struct.pack(">I", len(content))
        + kind
        + content
        + struct.pack(">I", zlib.crc32(kind + content))
    )


def test_significant_bits_do_not_change_the_scale(tmp_path):
    path = tmp_path / "a.png"
    png16(path, VALUES, greyscale=False, before_data=chunk(b"sBIT", bytes([10, 10, 10])))
    assert np.allclose(read_image(path), VALUES / 65535, atol=1e-6)


def test_a_transparent_color_of_16_bits_is_warned_about(tmp_path):
    path = tmp_path / "a.png"
    color = tuple(map(int, VALUES[1, 2]))
    png16(path, VALUES, greyscale=False, transparent=color)
    with pytest.warns(JotlightWarning, match=r"a\.png: 1 of \d+ pixels are transparent"):
        assert np.allclose(read_image(path), VALUES / 65535, atol=1e-6)
    png16(path, VALUES, greyscale=False, transparent=(color[0], color[1], color[2] ^ 1))
    read_image(path)


def test_gray_with_transparency_keeps_its_16_bits(tmp_path):
    path = tmp_path / "a.png"
    values = VALUES[..., :2].copy()
    values[..., 1] = 65535
    png16(path, values, greyscale=True, alpha=True)
    assert np.allclose(read_image(path), VALUES[..., 0] / 65535, atol=1e-6)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_16_bit_png_has_the_orientation_of_8_bits_in_pillow(tmp_path, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    eight = Image.fromarray((VALUES >> 8).astype(np.uint8))
    eight.save(tmp_path / "eight.png", exif=exif)
    # Pillow writes the EXIF data of a PNG without the marker of a JPEG.
    content = exif.tobytes().removeprefix(b"Exif\x00\x00")
    png16(tmp_path / "a.png", VALUES, greyscale=False, before_data=chunk(b"eXIf", content))
    turned = read_image(tmp_path / "a.png")
    expected = read_image(tmp_path / "eight.png")
    assert turned.shape == expected.shape
    assert np.abs(turned - expected).max() < 1 / 200


@pytest.mark.parametrize("length", [0, 8, 20, 25, 26, 60])
def test_the_error_of_a_truncated_16_bit_png_names_it(tmp_path, length):
    path = tmp_path / "a.png"
    png16(path, VALUES, greyscale=False)
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(ValueError, match=r"a\.png"):
        read_image(path)
