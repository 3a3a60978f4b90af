"""The planes that a color network reads."""

import numpy as np
import pytest

from jotlight.networks.planes.color_planes import CENTER, START, Filtered, color_planes
from jotlight.sensing.parameters.mosaic import Mosaic

DARK, SLOPE = 0.1, 0.5


def probability(intensity):
    return -np.expm1(-(SLOPE * intensity + DARK))


def angle(p):
    return np.arcsin(np.sqrt(p))


def seen_through(mosaic, colors, weight=1.0):
    """Return exact fractions of ones behind each filter of a mosaic."""
    places = mosaic.full(*colors.shape[:2])
    fraction = probability(mosaic.light(colors))
    return [
        Filtered(transmission, fraction, weight * (places == index))
        for index, transmission in enumerate(mosaic.transmission)
    ]


@pytest.mark.parametrize("pattern", ["RGGB", "RGBW", "CMYG", "RGB", "RGBW/BWRG"])
def test_bits_that_fit_the_classical_colors_deviate_by_nothing(pattern):
    colors = np.random.default_rng(0).random((12, 15, 3))
    start = np.moveaxis(colors, -1, 0)
    planes = color_planes(seen_through(Mosaic(pattern), colors), start, probability)
    np.testing.assert_allclose(planes[START], angle(probability(start)) - CENTER, atol=1e-6)
    np.testing.assert_allclose(planes[:4], 0, atol=1e-6)


def test_the_shares_state_the_filters_and_a_dead_pixel_has_none():
    weight = np.ones((4, 4))
    weight[0, 0], weight[0, 1] = 0, 0.25  # no bits, and a quarter of them
    colors = np.full((4, 4, 3), 0.5)
    seen = seen_through(Mosaic("RGYW"), colors, weight)
    shares = color_planes(seen, np.zeros((3, 4, 4)), probability)[4:8]
    np.testing.assert_array_equal(shares[:, 0, 0], 0)
    np.testing.assert_array_equal(shares[:, 0, 1], [0, 0.25, 0, 0])
    np.testing.assert_array_equal(shares[:, 1, 0], [1, 1, 0, 0])
    np.testing.assert_array_equal(shares[:, 1, 1], [0, 0, 0, 1])


def test_a_deviation_is_that_of_the_filter_of_its_pixel():
    rng = np.random.default_rng(1)
    start, fraction = rng.random((3, 8, 8)), rng.integers(0, 17, (8, 8)) / 16
    mosaic = Mosaic("RGBW")
    places = mosaic.full(8, 8)
    seen = [
        Filtered(transmission, fraction, 1.0 * (places == index))
        for index, transmission in enumerate(mosaic.transmission)
    ]
    deviations = color_planes(seen, start, probability)[:4]
    white = angle(fraction[1, 1]) - angle(probability(start[:, 1, 1].sum()))
    red = angle(fraction[2, 4]) - angle(probability(start[0, 2, 4]))
    np.testing.assert_allclose(deviations[:, 1, 1], [0, 0, 0, white], atol=1e-6)
    np.testing.assert_allclose(deviations[:, 2, 4], [red, 0, 0, 0], atol=1e-6)
