"""Maps and masks of jots in files."""

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from jotlight.formats.images.maps import read_map, read_mask

MAP = np.random.default_rng(0).random((6, 11))


def test_masks_are_read_from_arrays_and_images(tmp_path):
    mask = np.zeros((6, 11), bool)
    mask[2, 3] = True
    np.save(tmp_path / "a.npy", mask)
    Image.fromarray(mask).save(tmp_path / "one.png")
    Image.fromarray(mask.astype(np.uint8) * 255).save(tmp_path / "eight.png")
    tifffile.imwrite(tmp_path / "eight.tif", mask.astype(np.uint8) * 255)
    np.save(tmp_path / "ones.npy", mask.astype(np.int64))
    np.save(tmp_path / "eight.npy", mask.astype(np.uint8) * 255)
    for name in ("a.npy", "ones.npy", "eight.npy", "one.png", "eight.png", "eight.tif"):
        np.testing.assert_array_equal(read_mask(tmp_path / name), mask)
    Image.fromarray(~mask).save(tmp_path / "one.png")
    with pytest.warns(jl.JotlightWarning, match="invert it"):
        read_mask(tmp_path / "one.png")


@pytest.mark.parametrize("name", ["mask.mat", "mask.h5", "mask"])
def test_other_files_are_no_masks(tmp_path, name):
    (tmp_path / name).write_bytes(b"a file")
    with pytest.raises(
        ValueError, match=r"expected a mask in a \.npy, \.png, \.tif, or \.tiff file"
    ):
        read_mask(tmp_path / name)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint16])
@pytest.mark.parametrize("name", ["map.npy", "map.tif", "MAP.TIFF"])
def test_maps_have_the_numbers_of_their_files(tmp_path, name, dtype):
    values = (1000 * MAP).astype(dtype)
    save = np.save if name.endswith(".npy") else tifffile.imwrite
    save(tmp_path / name, values)
    found = read_map(tmp_path / name)
    assert found.dtype == dtype
    np.testing.assert_array_equal(found, values)


@pytest.mark.parametrize(
    ("values", "options"),
    [(np.stack([MAP, MAP]), {}), (np.stack([MAP] * 3, axis=-1), {"photometric": "rgb"})],
)
def test_stacks_and_colors_are_no_maps(tmp_path, values, options):
    tifffile.imwrite(tmp_path / "a.tif", values.astype(np.float32), **options)
    with pytest.raises(ValueError, match=r"expected a map of the jots, one image \(H, W\), got"):
        read_map(tmp_path / "a.tif")


def test_a_map_that_is_not_there(tmp_path):
    for name in ("a.npy", "a.tif"):
        with pytest.raises(FileNotFoundError, match="there is no file"):
            read_map(tmp_path / name)
