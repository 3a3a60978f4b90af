"""Fixtures that several files of tests of the command line use."""

import sys

import numpy as np
import pytest
from PIL import Image

import jotlight as jl


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "photo.png"
    levels = (jl.datasets.photograph("camera")[100:140, 180:229] * 255).astype(np.uint8)
    Image.fromarray(levels).save(path)
    return path


@pytest.fixture
def color(tmp_path):
    path = tmp_path / "color.png"
    levels = (jl.datasets.photograph("coffee")[100:140, 180:229] * 255).astype(np.uint8)
    Image.fromarray(levels).save(path)
    return path


@pytest.fixture
def own_module(tmp_path, monkeypatch):
    """Return the name of a module in the current folder, with a method and one that fails."""
    code = "def mean(bits):\n    return bits.counts() / 4\ndef fails(bits):\n    return 1 / 0\n"
    (tmp_path / "own_cli_module.py").write_text(code)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "own_cli_module", raising=False)
    yield "own_cli_module"
    sys.modules.pop("own_cli_module", None)
