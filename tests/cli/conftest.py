"""Fixtures that several files of tests of the command line use."""

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
