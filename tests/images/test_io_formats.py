"""Formats of photographs that Pillow opens."""

import numpy as np
import pytest
from PIL import Image

from jotlight.images.io import read_image, read_note


def test_a_photograph_in_postscript_starts_no_other_program(tmp_path, monkeypatch):
    def start(*args, **options):
        raise AssertionError("starts a program")

    monkeypatch.setattr("subprocess.Popen", start)
    path = tmp_path / "a.jpg"
    path.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 64 64\n%%EndComments\n")
    with pytest.raises(ValueError, match=r"a\.jpg: .*no known format fits"):
        read_image(path)
    assert read_note(path) == {}


@pytest.mark.parametrize("kind", ["TIFF", "ICO", "ICNS", "JPEG2000", "TGA"])
def test_only_known_formats_are_opened_by_pillow(tmp_path, kind):
    path = tmp_path / "a.jpg"
    with path.open("wb") as file:
        Image.new("RGB", (64, 64)).save(file, kind)
    with pytest.raises(ValueError, match="no known format fits"):
        read_image(path)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "WEBP", "PPM", "GIF"])
def test_the_content_of_a_photograph_decides_its_format(tmp_path, kind):
    path = tmp_path / "a.jpg"
    with path.open("wb") as file:
        Image.new("RGB", (4, 5), "white").save(file, kind)
    np.testing.assert_allclose(read_image(path), 1)
