"""Fixtures that several files of tests of the command line use."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from moving import record


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
def moving(tmp_path):
    """Return the bits of a shaking camera, which are also in a file of the current folder."""
    _, bits = record("shake", shape=(48, 64))
    jl.save(bits, tmp_path / "moving.npy")
    return bits


@pytest.fixture
def own_module(tmp_path, monkeypatch):
    """Return the name of a module in the current folder, with a method and one that fails."""
    code = "def mean(bits):\n    return bits.counts() / 4\ndef fails(bits):\n    return 1 / 0\n"
    (tmp_path / "own_cli_module.py").write_text(code)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "own_cli_module", raising=False)
    yield "own_cli_module"
    sys.modules.pop("own_cli_module", None)


@pytest.fixture
def captures(tmp_path, monkeypatch):
    """Return three captures below the current folder: a/1, a/2, and b/1."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    for name in ("a/1", "a/2", "b/1"):
        path = Path("captures", f"{name}.npy")
        path.parent.mkdir(parents=True, exist_ok=True)
        jl.save(jl.Bits.from_array(rng.random((64, 16, 24)) < 0.4, jl.Sensor(frames=64)), path)
    return sorted(Path("captures").rglob("*.npy"))
