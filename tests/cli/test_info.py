"""What `jotlight info` tells of files that may be pictures or counts."""

import numpy as np
import png
import pytest
import tifffile
from PIL import Image

from jotlight.formats.writing import write_capture
from jotlight.sensing.provenance import Provenance

COUNTS = np.random.default_rng(0).integers(0, 5, (6, 9), np.uint8)
COUNTS[0, :2] = 0, 4


def lines(run, *words):
    status, said = run("info", *words)
    assert status == 0
    return [" ".join(line.split()) for line in said.splitlines()]


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_levels_may_be_counts_or_a_picture(run, tmp_path, name):
    if name == "a.png":
        Image.fromarray(COUNTS).save(tmp_path / name)
    else:
        tifffile.imwrite(tmp_path / name, COUNTS)
    said = lines(run, name)
    assert "kind counts, or an image" in said
    assert "counts 0 to 4" in said
    assert "image float32, 0 to 0.01569" in said
    assert "values int32, 0 to 4" in lines(run, name, "--counts")


def test_a_stack_of_levels_is_counts(run, tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.stack([COUNTS] * 7), photometric="minisblack")
    said = lines(run, "a.tif")
    assert "images 7" in said
    assert "values int32, 0 to 28" in said


def test_colour_is_a_picture(run, tmp_path):
    Image.fromarray(np.stack([COUNTS] * 3, axis=2)).save(tmp_path / "a.png")
    assert "kind image" in lines(run, "a.png")


@pytest.mark.parametrize("name", ["tiff", "npz"])
def test_what_we_wrote_is_told_as_counts(run, tmp_path, name):
    path = "a.tif" if name == "tiff" else "a.npz"
    provenance = Provenance("npy", "cube.npy")
    write_capture(COUNTS.astype(np.int32), tmp_path / path, name, trials=64, provenance=provenance)
    said = lines(run, path)
    assert f"format {name}" in said
    assert "assumed counts out of 64, as the file states" in said
    assert "from npy, cube.npy" in said
    assert "values int32, 0 to 4" in said


@pytest.mark.parametrize(("depth", "palette"), [(1, False), (2, False), (4, False), (2, True)])
def test_the_levels_of_a_shallow_png_are_told_as_they_are_read(run, tmp_path, depth, palette):
    levels = np.arange(24).reshape(4, 6) % 2**depth
    colours = [(80 * level, 0, 255) for level in range(4)] if palette else None
    with (tmp_path / "a.png").open("wb") as file:
        kind = {"palette": colours} if palette else {"greyscale": True}
        png.Writer(6, 4, bitdepth=depth, **kind).write(file, levels.tolist())
    said = lines(run, "a.png")
    kind = "bits" if depth == 1 else "counts"
    assert f"kind {kind}, or an image" in said
    assert f"{kind} 0 to {2**depth - 1}" in said
    assert f"--{kind} shows it as a capture" in said
    assert f"kind {kind}" in lines(run, "a.png", f"--{kind}")
