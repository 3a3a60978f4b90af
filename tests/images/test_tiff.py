"""Images in TIFF files: their channels and their transparency."""

import numpy as np
import pytest
import tifffile

from jotlight.errors import JotlightWarning
from jotlight.images.image_stack import stack_writer
from jotlight.images.io import image_writer, read_image

LEVELS = np.random.default_rng(0).integers(0, 256, (6, 7, 3), np.uint8)
APART = {"planarconfig": "separate"}


def test_colors_that_are_stored_apart_are_channels(tmp_path):
    apart = np.moveaxis(LEVELS, -1, 0)
    tifffile.imwrite(tmp_path / "a.tif", apart, photometric="rgb", **APART)
    np.testing.assert_allclose(read_image(tmp_path / "a.tif"), LEVELS / 255, atol=1e-6)


@pytest.mark.parametrize(("kind", "channels"), [("unassalpha", 1), ("unspecified", 2)])
def test_only_transparency_is_dropped_of_two_channels(tmp_path, kind, channels):
    options = {"photometric": "minisblack", "planarconfig": "contig", "extrasamples": [kind]}
    levels = LEVELS[..., :2].copy()
    levels[..., 1] = 255
    tifffile.imwrite(tmp_path / "a.tif", levels, **options)
    expected = levels[..., :channels].squeeze() / 255
    np.testing.assert_allclose(read_image(tmp_path / "a.tif"), expected, atol=1e-6)


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize(("channels", "photometric"), [(2, "minisblack"), (4, "rgb")])
def test_the_transparency_of_stacks_is_dropped_too(tmp_path, channels, photometric, apart):
    levels = np.random.default_rng(0).integers(0, 255, (5, 6, 7, channels), np.uint8)
    options = {"photometric": photometric, "extrasamples": ["unassalpha"]}
    stored = np.moveaxis(levels, -1, 1) if apart else levels
    planes = "separate" if apart else "contig"
    tifffile.imwrite(tmp_path / "a.tif", stored, planarconfig=planes, **options)
    with pytest.warns(JotlightWarning, match=r"a\.tif: 210 of 210 pixels are transparent"):
        images = read_image(tmp_path / "a.tif")
    expected = (levels[..., 0] if channels == 2 else levels[..., :3]) / 255
    np.testing.assert_allclose(images, expected, atol=1e-6)


@pytest.mark.parametrize("channels", [2, 4])
def test_two_and_four_channels_are_written_and_read(tmp_path, channels):
    image = np.random.default_rng(0).random((6, 7, channels), np.float32)
    image_writer(tmp_path / "a.tif")(tmp_path / "a.tif", image)
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), image)
    stack_writer(tmp_path / "b.tif")(tmp_path / "b.tif", {"low": image, "high": image + 1})
    np.testing.assert_array_equal(read_image(tmp_path / "b.tif"), [image, image + 1])


def test_the_command_line_reconstructs_two_channels(tmp_path, run):
    counts = LEVELS[..., :2] % 5
    options = {"photometric": "minisblack", "planarconfig": "contig"}
    tifffile.imwrite(tmp_path / "a.tif", counts, **options)
    status, said = run("reconstruct", "a.tif", "-o", "b.tif", "--method", "mle", "--frames", "4")
    assert status == 0, said
    assert read_image(tmp_path / "b.tif").shape == counts.shape
