"""The planes of film networks, compared with loops over pixels."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from jotlight.networks.film_planes import PLANES, Counts, film_planes, usual_trials

SHAPE = 5, 7


def random_counts(rng, most, *, least=0):
    trials = rng.integers(least, most + 1, SHAPE).astype(np.float32)
    ones = rng.binomial(trials.astype(int), 0.4)
    return Counts((ones / np.maximum(trials, 1)).astype(np.float32), trials)


def z_of(fraction):
    return math.asin(math.sqrt(fraction))


@pytest.mark.parametrize("seed", range(4))
def test_planes_are_those_of_a_loop_over_pixels(seed):
    rng = np.random.default_rng(seed)
    counts = [random_counts(rng, 40, least=1), random_counts(rng, 10), random_counts(rng, 3)]
    last = rng.random(SHAPE).astype(np.float32)
    last[rng.random(SHAPE) < 0.3] = np.nan
    usual = usual_trials(counts[0])
    assert usual == np.median(counts[0].trials)
    found = film_planes(counts, usual, last)
    expected = np.zeros((PLANES, *SHAPE))
    for place in np.ndindex(SHAPE):
        present = z_of(counts[0].fraction[place])
        expected[0][place] = present - math.pi / 4
        for index, each in enumerate(counts):
            expected[2 * index + 1][place] = min(2, math.sqrt(each.trials[place] / usual))
            if index and each.trials[place] > 0:
                expected[2 * index][place] = z_of(each.fraction[place]) - present
        if np.isfinite(last[place]):
            expected[6][place], expected[7][place] = last[place] - present, 1
    expected[8] = gaussian_filter(expected[0], 0.8, mode="mirror")
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert found.dtype == np.float32


def test_pixels_without_readings_take_their_neighbors_and_the_first_image_has_no_last():
    rng = np.random.default_rng(0)
    window = random_counts(rng, 9, least=1)
    hole = window.trials.copy()
    hole[2, 3] = 0
    fraction = window.fraction.copy()
    fraction[2, 2:5] = fraction[1:4, 3] = 0.25
    fraction[2, 3] = 0.9  # it has no readings, so this number means nothing
    planes = film_planes([Counts(fraction, hole)] * 3, 4.0, None)
    assert planes[0, 2, 3] == pytest.approx(z_of(0.25) - math.pi / 4, abs=1e-6)
    assert planes[1, 2, 3] == planes[2, 2, 3] == 0
    assert not planes[6:8].any()


def test_the_usual_trials_are_those_of_pixels_with_readings():
    fraction = np.zeros((1, 5), np.float32)
    assert usual_trials(Counts(fraction, np.float32([[0, 0, 0, 4, 8]]))) == 6
    nothing = Counts(fraction, np.zeros((1, 5), np.float32))
    assert usual_trials(nothing) == 1
    assert np.isfinite(film_planes([nothing] * 3, 1.0, None)).all()
