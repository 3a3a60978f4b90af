"""Notes in PNG files."""

import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from jotlight.formats.images.png_notes import KEYWORD, read_png_note


def _save(path, text):
    info = PngInfo()
    info.add_text(KEYWORD, text)
    Image.fromarray(np.zeros((40, 50), np.uint8)).save(path, pnginfo=info)


@pytest.mark.parametrize("text", ["", "words", "[1]", "{", "[" * 100_000])
def test_other_texts_are_no_notes(tmp_path, text):
    _save(tmp_path / "a.png", text)
    assert read_png_note(tmp_path / "a.png") == {}


def test_a_damaged_file_has_no_note(tmp_path):
    _save(tmp_path / "a.png", '{"a": 1}')
    content = (tmp_path / "a.png").read_bytes()
    assert read_png_note(tmp_path / "a.png") == {"a": 1}
    for damaged in (b"", content[:20], content[:50], content.replace(b'"a"', b'"b"')):
        (tmp_path / "a.png").write_bytes(damaged)
        assert read_png_note(tmp_path / "a.png") == {}
