"""Colors on lines against NumPy and SciPy, and the fringes that they remove."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

import jotlight as jl
from jotlight import _engine as engine
from jotlight.networks.color.fringes import remove_fringes
from jotlight.sensing.parameters.mosaic import Mosaic


def lines_by_numpy(colors):
    """Return colors on lines, as the engine's module `color_lines` describes them."""
    red, green, blue = colors.astype(np.float64)
    light = (red + 2 * green + blue) / 4
    differences = [red - light, blue - light]
    weights, found = 0.0, np.zeros((2, 2, *light.shape))
    for side in (5, 9):

        def mean(values, side=side):
            return uniform_filter(values, side, mode="reflect")

        level = mean(light)
        variance = mean(light**2) - level**2 + 4e-4 * level**2
        lines, deviation = [], 1e-3 * level**2
        for difference in differences:
            average = mean(difference)
            covariance = mean(difference * light) - average * level
            slope = covariance / variance
            lines.append((slope, average - slope * level))
            deviation += np.maximum(mean(difference**2) - average**2 - slope * covariance, 0)
        weight = deviation**-3.0
        weights = weights + mean(weight)
        found += [[mean(weight * each) for each in line] for line in lines]
    red, blue = ((slope * light + offset) / weights for slope, offset in found)
    return np.stack([light + red, light - (red + blue) / 2, light + blue])


@pytest.mark.parametrize("level", engine.cpu_levels())
@pytest.mark.parametrize("shape", [(1, 1), (3, 2), (7, 300), (150, 70)])
def test_lines_are_those_of_numpy_for_any_number_of_threads(level, shape):
    colors = np.random.default_rng(0).random((3, *shape), np.float32) + np.float32(0.05)
    found = np.empty((2, *colors.shape), np.float32)
    engine.choose_cpu_level(level)
    try:
        for out, threads in zip(found, (1, 3), strict=True):
            engine.color_lines(colors, out, threads)
    finally:
        engine.choose_cpu_level(None)
    np.testing.assert_allclose(found[0], lines_by_numpy(colors), atol=2e-6)
    np.testing.assert_array_equal(found[1], found[0])


@pytest.mark.parametrize("scale", [0.0, 1e-6, 1e12, 1e37])
def test_lines_of_extreme_colors_are_finite_and_keep_the_light(scale):
    colors = np.random.default_rng(0).random((3, 40, 30), np.float32) * np.float32(scale)
    found = np.empty_like(colors)
    engine.color_lines(colors, found, None)
    red, green, blue = found - colors
    np.testing.assert_allclose(red + 2 * green + blue, 0, atol=1e-6 * scale)
    assert np.abs(found).max() <= 3 * scale


@pytest.mark.parametrize("exponent", [-90, -20, 20, 90])
def test_the_unit_of_the_colors_does_not_matter(exponent):
    colors = np.random.default_rng(0).random((3, 40, 30), np.float32)
    colors[:, :, 10:20] *= np.float32(1e-4)  # dark pixels
    scaled = np.ldexp(colors, exponent)
    found, of_scaled = np.empty((2, *colors.shape), np.float32)
    engine.color_lines(colors, found, None)
    engine.color_lines(scaled, of_scaled, None)
    np.testing.assert_array_equal(of_scaled, np.ldexp(found, exponent))


@pytest.mark.parametrize("shape", [(0, 5), (5, 0), (0, 0)])
def test_images_without_pixels_have_lines_without_pixels(shape):
    colors = np.empty((3, *shape), np.float32)
    engine.color_lines(colors, colors.copy(), None)


def test_mixtures_of_two_colors_stay_and_other_colors_between_them_are_fringes():
    rng = np.random.default_rng(0)
    share = rng.random((40, 40))
    white, blue = np.ones(3), np.array([0.1, 0.2, 0.6])
    exact = blue[:, None, None] + (white - blue)[:, None, None] * share
    mosaic = Mosaic("RGGB")
    kept = remove_fringes(exact.astype(np.float32), mosaic, None)
    assert np.abs(kept - exact).max() < 5e-3
    fringes = exact.astype(np.float32)
    changed = np.zeros((40, 40), bool)
    changed[::7, ::7] = True
    fringes[0, changed] -= 0.3
    errors = np.abs(remove_fringes(fringes, mosaic, None) - exact)[0]
    # Half of what the pixels see is kept, and nothing where they do not see red.
    sees_red = mosaic.full(40, 40) == 0
    assert errors[changed & ~sees_red].max() < 0.15
    assert errors[changed & sees_red].max() > 0.15


def test_shapes_that_do_not_fit_are_refused():
    for colors, out in (((2, 4, 4), (2, 4, 4)), ((3, 4, 4), (3, 4, 5))):
        with pytest.raises(ValueError, match="expected"):
            engine.color_lines(np.zeros(colors, np.float32), np.zeros(out, np.float32), None)


@pytest.mark.slow
def test_black_text_behind_a_mosaic_has_less_color_than_the_network_alone(monkeypatch):
    from PIL import Image, ImageDraw

    page = Image.new("RGB", (128, 128), "white")
    draw = ImageDraw.Draw(page)
    for row in range(8):
        draw.text((3, 16 * row + 2), "Photons arrive 0123", fill="black")
    image = np.asarray(page, np.float64) / 255
    bits = jl.Sensor(frames=64, mosaic="RGGB").expose(image, rng=0)

    def color(found):
        return np.sqrt(np.mean((found - found.mean(axis=2, keepdims=True)) ** 2))

    found = jl.reconstruct(bits)
    name = "jotlight.networks.color.color_inference.remove_fringes"
    monkeypatch.setattr(name, lambda colors, *_: colors)
    alone = jl.reconstruct(bits)
    assert color(found) < 0.7 * color(alone)
    assert np.mean((found - image) ** 2) < np.mean((alone - image) ** 2)
