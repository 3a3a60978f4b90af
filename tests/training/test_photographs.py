"""Patches of photographs: planes, scales, and tones."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image
from scipy.stats import binom
from skimage.color import rgb2xyz

import jotlight as jl
from jotlight.training import PhotographPatches, read_photographs

NUMBER = 1500
COLORS = 10, 100, 200
COLOR = np.full((12, 16, 3), COLORS, np.uint8)
GRAY = np.arange(256, dtype=np.uint8).reshape(16, 16)


class LargestScale:
    """A generator whose uniform numbers are always the largest."""

    def __init__(self):
        generator = np.random.default_rng(0)
        self.integers, self.random = generator.integers, generator.random

    def uniform(self, low, high):
        return high


def draw(source, side, number=NUMBER):
    generator = np.random.default_rng(0)
    return [source.draw(generator, side) for _ in range(number)]


def is_binomial(count, fraction):
    low, high = binom.ppf([1e-6, 1 - 1e-6], NUMBER, fraction)
    return low <= count <= high


@pytest.mark.slow
def test_a_fraction_of_the_patches_is_a_color_plane():
    patches = draw(PhotographPatches([COLOR], color=0.3, linear=0.0), 8)
    levels = np.array([np.rint(255 * patch.values.mean()) for patch in patches])
    for patch, level in zip(patches, levels, strict=True):
        np.testing.assert_allclose(patch.values, level / 255, rtol=1e-5)
        assert patch.image_mean == pytest.approx(level / 255)
    luma = round(0.299 * 10 + 0.587 * 100 + 0.114 * 200)
    assert is_binomial((levels == luma).sum(), 0.7)
    assert all(is_binomial((levels == level).sum(), 0.1) for level in COLORS)


@pytest.mark.slow
def test_a_fraction_of_the_patches_is_linear_in_light():
    source = PhotographPatches([GRAY], linear=0.4, scaled=0.0)
    encoded = GRAY / 255
    linear = rgb2xyz(np.repeat(encoded[..., None], 3, axis=2))[..., 1]
    patches = draw(source, 16)
    is_linear = np.array([patch.image_mean < 0.45 for patch in patches])
    assert is_binomial(is_linear.sum(), 0.4)
    for patch, chosen in zip(patches, is_linear, strict=True):
        expected = linear if chosen else encoded
        np.testing.assert_allclose(np.sort(patch.values, None), np.sort(expected, None), atol=1e-5)
        assert patch.image_mean == pytest.approx(expected.mean(), abs=1e-5)


@pytest.mark.slow
def test_scaled_patches_are_averages_over_areas():
    # The area averages of a ramp are a ramp, which is as many times steeper as the areas are wide.
    ramp = np.tile(np.arange(0, 200, 2, dtype=np.uint8), (90, 1))
    patches = draw(PhotographPatches([ramp], linear=0.0, scaled=0.6), 20)
    factors = []
    for patch in patches:
        rows, columns = (np.diff(patch.values, axis=axis) for axis in (0, 1))
        steps, flat = (rows, columns) if abs(rows).max() > abs(columns).max() else (columns, rows)
        assert abs(flat).max() < 1e-5
        # Within a pixel, the photograph is constant, so the averages are not exactly a ramp.
        np.testing.assert_allclose(steps, steps.mean(), atol=0.003)
        factors.append(abs(steps.mean()) * 255 / 2)
        # Rows and columns of a ramp at its ends would show averages beyond its borders.
        assert patch.values.min() > -1e-6
        assert patch.values.max() < 198 / 255 + 1e-6
    factors = np.array(factors)
    assert is_binomial((abs(factors - 1) > 1e-4).sum(), 0.6)
    assert factors.min() > 0.97
    assert 2.9 < factors.max() < 3.03


def test_averages_agree_with_a_finer_grid():
    levels = np.random.default_rng(3).integers(0, 256, (30, 30)).astype(np.uint8)
    # The whole photograph in 12 × 12 pixels: areas of 2.5 × 2.5 pixels.
    source = PhotographPatches([levels], linear=0.0, scaled=1.0, max_scale=2.5)
    values = source.draw(LargestScale(), 12).values
    halves = np.kron(levels / 255, np.ones((2, 2)))
    expected = halves.reshape(12, 5, 12, 5).mean((1, 3))
    symmetric = [np.rot90(x, k) for k in range(4) for x in (expected, expected.T)]
    assert min(abs(values - other).max() for other in symmetric) < 1e-5


def test_a_patch_may_be_the_whole_photograph():
    patches = draw(PhotographPatches([GRAY], linear=0.0, scaled=1.0), 16, 20)
    for patch in patches:
        np.testing.assert_allclose(np.sort(patch.values, None), GRAY.ravel() / 255, atol=1e-6)


def test_files_are_read_as_8_bit_levels(tmp_path):
    Image.fromarray(COLOR).save(tmp_path / "color.png")
    Image.fromarray(GRAY).save(tmp_path / "gray.png")
    fractions = []
    paths = [tmp_path / "color.png", tmp_path / "gray.png"]
    source = PhotographPatches.read(paths, progress=fractions.append, linear=0.0)
    assert fractions == [0.5, 1.0]
    assert source.linear == 0.0
    assert source.fingerprint() == PhotographPatches([COLOR, GRAY], linear=0.0).fingerprint()
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\n broken")
    with pytest.raises(ValueError, match=r"broken\.png"):
        PhotographPatches.read([tmp_path / "broken.png"])


@pytest.mark.parametrize("read", [PhotographPatches.read, read_photographs])
@pytest.mark.parametrize("path", ["photo.png", Path("photo.png")], ids=["str", "Path"])
def test_a_single_path_in_place_of_a_list_is_refused(read, path):
    message = r"paths: expected a list .*pass \['photo\.png'\], or sorted\(.*\.iterdir\(\)\)"
    with pytest.raises(TypeError, match=message):
        read(path)


def test_the_white_of_files_of_16_bits_can_be_stated(tmp_path):
    levels = np.arange(0, 1024, 4, dtype=np.uint16).reshape(16, 16)
    tifffile.imwrite(tmp_path / "photograph.tif", levels)
    with pytest.raises(ValueError, match="state the level of intensity 1 with white="):
        read_photographs([tmp_path / "photograph.tif"])
    source = PhotographPatches.read([tmp_path / "photograph.tif"], white=1023, scaled=0.0)
    np.testing.assert_array_equal(source.photographs[0][0], np.rint(levels / 1023 * 255))


@pytest.mark.parametrize("read", [PhotographPatches.read, read_photographs])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_photographs_that_are_not_finite_are_refused(tmp_path, read, value):
    image = np.full((8, 8), 0.5, np.float32)
    image[0, 0] = value
    tifffile.imwrite(tmp_path / "photograph.tif", image)
    with pytest.raises(ValueError, match=r"photograph\.tif: expected finite intensities, got NaN"):
        read([tmp_path / "photograph.tif"])


def test_photographs_that_become_white_are_reported(tmp_path):
    bright = 16 * GRAY.astype(np.float32) / 255
    tifffile.imwrite(tmp_path / "bright.tif", bright)
    with pytest.warns(jl.JotlightWarning, match=r"bright\.tif: .* up to 16, and become white"):
        read_photographs([tmp_path / "bright.tif"])
    (levels,) = read_photographs([tmp_path / "bright.tif"], white=16)
    np.testing.assert_array_equal(levels, GRAY)


def test_patches_are_as_high_as_the_photograph_is_wide():
    patches = draw(PhotographPatches([GRAY[:, :12]], scaled=1.0), 12, 50)
    assert {patch.values.shape for patch in patches} == {(12, 12)}


@pytest.mark.parametrize(
    ("photographs", "settings", "message"),
    [
        ("a.png", {}, r"expected a list of uint8 arrays, .*read_photographs\(paths\), got a path"),
        (PhotographPatches([GRAY]), {}, "expected a list of uint8 arrays, .*got PhotographPatches"),
        ([], {}, "photographs: expected at least one, got none"),
        ([COLOR / 255], {}, r"uint8 arrays, got float64 for number 0; \(255 \* image\)"),
        ([GRAY, "name.png"], {}, "photographs: expected uint8 arrays, got str for number 1"),
        ([COLOR[..., :2]], {}, r"expected shapes \(H, W\) or \(H, W, 3\), got \(12, 16, 2\)"),
        ([GRAY[:0]], {}, r"expected shapes .* got \(0, 16\)"),
        ([GRAY], {"color": 1.1}, r"color: expected a fraction in \[0, 1\], got 1.1"),
        ([GRAY], {"linear": float("nan")}, "linear: expected a fraction"),
        ([GRAY], {"scaled": -0.1}, "scaled: expected a fraction"),
        ([GRAY], {"max_scale": 0.5}, "max_scale: expected a finite number of 1 or more, got 0.5"),
    ],
)
def test_photographs_and_settings_that_do_not_fit_are_refused(photographs, settings, message):
    with pytest.raises((TypeError, ValueError), match=message):
        PhotographPatches(photographs, **settings)
