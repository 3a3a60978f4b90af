"""The planes of film networks, compared with loops over pixels."""

import math

import numpy as np
import pytest

from jotlight.networks.planes.film_planes import PLANES, Counts, film_planes, usual_trials

SHAPE = 5, 7


def random_counts(rng, most):
    trials = rng.integers(0, most + 1, SHAPE).astype(np.float32)
    ones = rng.binomial(trials.astype(int), 0.4)
    return Counts((ones / np.maximum(trials, 1)).astype(np.float32), trials)


def z_of(fraction):
    return math.asin(math.sqrt(fraction))


@pytest.mark.parametrize("seed", range(4))
def test_planes_are_those_of_a_loop_over_pixels(seed):
    rng = np.random.default_rng(seed)
    counts = [random_counts(rng, most) for most in (40, 10, 3, 3, 3, 4, 2)]
    start = rng.random(SHAPE).astype(np.float32)
    last = rng.random(SHAPE).astype(np.float32)
    last[rng.random(SHAPE) < 0.3] = np.nan
    usual = usual_trials(counts[0])
    assert usual == np.median(counts[0].trials[counts[0].trials > 0])
    found = film_planes(start, counts, usual, last)
    expected = np.zeros((PLANES, *SHAPE))
    for place in np.ndindex(SHAPE):
        estimate = z_of(start[place])
        expected[8][place] = estimate - math.pi / 4
        for index, each in enumerate(counts):
            if index < 3:
                expected[2 * index + 1][place] = min(1.5, math.sqrt(each.trials[place] / usual))
            if each.trials[place] > 0:
                plane = 2 * index if index < 3 else 6 + index
                expected[plane][place] = z_of(each.fraction[place]) - estimate
        mean = np.mean([each.trials[place] for each in counts[3:]])
        expected[13][place] = min(1.5, math.sqrt(mean / usual))
        if np.isfinite(last[place]):
            expected[6][place], expected[7][place] = last[place] - estimate, 1
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert found.dtype == np.float32


def test_the_first_image_has_no_last_one():
    rng = np.random.default_rng(0)
    counts = [random_counts(rng, 9)] * 7
    planes = film_planes(np.full(SHAPE, 0.5, np.float32), counts, 9.0, None)
    assert not planes[6:8].any()
    assert planes[[*range(6), *range(9, PLANES)]].any(axis=(1, 2)).all()


def test_the_usual_trials_are_those_of_pixels_with_readings():
    fraction = np.zeros((1, 5), np.float32)
    assert usual_trials(Counts(fraction, np.float32([[0, 0, 0, 4, 8]]))) == 6
    nothing = Counts(fraction, np.zeros((1, 5), np.float32))
    assert usual_trials(nothing) == 1
    assert np.isfinite(film_planes(fraction, [nothing] * 7, 1.0, None)).all()
