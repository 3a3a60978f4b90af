"""No flipped bit in a file that jotlight wrote goes undetected."""

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from examples.captures import BITS, BITS_WITH_MAPS, COUNTS
from jotlight.formats.images.maps import read_mask
from jotlight.formats.verification import verify_capture
from jotlight.images.io import image_writer, read_image

SAMPLE = 40
"""Number of flips of a file in the fast test."""

RNG = np.random.default_rng(0)


def saves(data):
    """Return a function that writes a capture."""
    return lambda path: jl.save(data, path)


def saves_mask(path):
    """Write a PNG of depth 1."""
    Image.fromarray(RNG.random((6, 13)) < 0.1).save(path)


def saves_image(depth, *shape):
    """Return a function that writes an image as PNG."""
    return lambda path: image_writer(path, depth=depth)(path, RNG.random(shape))


CASES = {
    "bits in HDF5": ("a.h5", saves(BITS_WITH_MAPS), verify_capture),
    "counts in HDF5": ("a.h5", saves(COUNTS), verify_capture),
    "MATLAB": ("a", lambda path: jl.save(BITS, path, format="matlab"), verify_capture),
    "counts in a PNG of 8 bits": ("a.png", saves(COUNTS % 256), verify_capture),
    "counts in a PNG of 16 bits": ("a.png", saves(COUNTS), verify_capture),
    "mask in a PNG": ("a.png", saves_mask, read_mask),
    "gray PNG of 8 bits": ("a.png", saves_image(8, 4, 5), read_image),
    "color PNG of 8 bits": ("a.png", saves_image(8, 4, 5, 3), read_image),
    "gray PNG of 16 bits": ("a.png", saves_image(16, 4, 5), read_image),
    "color PNG of 16 bits": ("a.png", saves_image(16, 4, 5, 3), read_image),
}
"""Name of the file or folder, function that writes it, and function that must refuse it."""


def check_flips(folder, case, sample=None):
    """Flip single bits of all files, at most `sample` of each, and check that each is refused."""
    name, write, read = CASES[case]
    if name.endswith(".h5"):
        pytest.importorskip("h5py")
    path = folder / name
    write(path)
    read(path)
    for file in [path] if path.is_file() else list(path.iterdir()):
        content = file.read_bytes()
        number = 8 * len(content)
        # A step without a common factor with 8 reaches all bits of a byte.
        for bit in range(0, number, 1 if sample is None else number // sample // 2 * 2 + 1):
            flipped = bytearray(content)
            flipped[bit // 8] ^= 1 << bit % 8
            file.write_bytes(flipped)
            with pytest.raises((ValueError, OSError), match=rf"{file.name}|{path.name}"):
                read(path)
        file.write_bytes(content)
    read(path)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.slow
def test_some_flips_are_refused(tmp_path, case):
    check_flips(tmp_path, case, SAMPLE)


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", CASES)
def test_all_flips_are_refused(tmp_path, case):
    check_flips(tmp_path, case)
