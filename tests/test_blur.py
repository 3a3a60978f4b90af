"""The Gaussian filter against SciPy, and what it refuses."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from jotlight import _engine as engine
from jotlight.blur import blur


@pytest.mark.parametrize("level", engine.cpu_levels())
@pytest.mark.parametrize("shape", [(1, 1), (17, 64), (3, 40, 129), (2, 1, 70)])
@pytest.mark.parametrize("sigma", [0.1, 0.75, 1.5, 8.0])
def test_blurred_images_are_those_of_scipy_for_any_number_of_threads(level, shape, sigma):
    images = np.random.default_rng(0).random(shape, np.float32)
    engine.choose_cpu_level(level)
    try:
        found = [blur(images, sigma, threads) for threads in (1, 3)]
    finally:
        engine.choose_cpu_level(None)
    sigmas = *[0] * (len(shape) - 2), sigma, sigma
    expected = gaussian_filter(images.astype(np.float64), sigmas, mode="reflect", truncate=3.0)
    np.testing.assert_allclose(found[0], expected, atol=2e-6)
    np.testing.assert_array_equal(found[1], found[0])


@pytest.mark.parametrize("shape", [(0, 4, 5), (2, 0, 5), (2, 4, 0)])
def test_images_without_pixels_stay(shape):
    images = np.empty(shape, np.float32)
    engine.blur(images, 1.0, images.copy(), None)


def test_a_filter_of_a_wrong_width_or_shape_is_refused():
    images = np.zeros((2, 4, 4), np.float32)
    for sigma in (0.0, -1.0, np.nan, 101.0):
        with pytest.raises(ValueError, match="width of the filter: expected above 0"):
            engine.blur(images, sigma, images.copy(), None)
    with pytest.raises(ValueError, match="output"):
        engine.blur(images, 1.0, images[:1].copy(), None)
