"""Outlines: which motion each pixel follows."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from jotlight.motion.outlines.outlines import (
    _cost,
    _with_short_outlines,
    choose_labels,
)
from jotlight.motion.tiles import tile_counts
from moving import blocks_of, record, track_of, two_halves


def test_each_half_follows_its_own_motion():
    velocities = (0.4, 0.3), (-0.3, 0.5)
    blocks = blocks_of(two_halves(velocities, 48))
    labels = choose_labels([track_of(blocks, velocity, 24) for velocity in velocities])
    assert labels.dtype == np.uint8
    assert (labels[:, :88] == 0).mean() > 0.95
    assert (labels[:, 104:] == 1).mean() > 0.95


def test_a_wrong_motion_is_followed_nowhere():
    scene, bits = record("shake", photons=0.3)
    blocks = blocks_of(bits)
    shape, number = tile_counts(blocks.size), len(blocks.centers)
    true = track_of(blocks, (0, 0), scene.reference)
    true.nodes += np.stack([scene.motion(time)[:, :1, :1] for time in blocks.centers])
    wrong = track_of(blocks, (1.5, -1.5), scene.reference)
    assert (choose_labels([wrong, true]) == 1).mean() > 0.97
    assert shape == (6, 6)
    assert number == 16
    # The cost is χ², which is about 1 if the bits agree.
    assert np.median(_cost(true)) == pytest.approx(1, abs=0.25)
    assert np.median(_cost(wrong)) > np.median(_cost(true)) + 0.1


def test_one_motion_has_no_outlines():
    _, bits = record("shake")
    assert (choose_labels([track_of(blocks_of(bits), (0, 0), 24)]) == 0).all()


@pytest.mark.slow
def test_smooth_costs_have_the_least_sum_of_squares_and_total_variation():
    """A general-purpose optimizer finds the same minimum, for a smooth approximation."""
    rng = np.random.default_rng(0)
    cells = rng.normal(size=(4, 5))
    cells[:, 3:] += 3
    cost = cells.repeat(4, axis=0).repeat(4, axis=1).astype(np.float32)

    def energy(values):
        field = values.reshape(4, 5)
        down = np.diff(field, axis=0, append=field[-1:])
        right = np.diff(field, axis=1, append=field[:, -1:])
        variation = np.sqrt(down**2 + right**2 + 1e-6).sum()
        return 0.5 * ((field - cells) ** 2).sum() + 0.75 * variation

    best = minimize(energy, cells.ravel(), method="L-BFGS-B", options={"maxiter": 2000}).x
    places = (np.indices((16, 20)) + 0.5) / 4 - 0.5
    expected = map_coordinates(best.reshape(4, 5), places, order=1, mode="nearest")
    # The iteration ends before it has converged everywhere.
    np.testing.assert_allclose(_with_short_outlines(cost), expected, atol=0.25)
    assert abs(_with_short_outlines(cost) - expected).mean() < 0.06


@pytest.mark.parametrize("size", [(1, 1), (4, 4), (5, 9), (33, 18)])
def test_constant_costs_are_kept_in_images_of_any_size(size):
    cost = np.full(size, 1.5, np.float32)
    np.testing.assert_allclose(_with_short_outlines(cost), 1.5, atol=1e-5)


def test_small_islands_vanish_and_large_areas_remain():
    cost = np.full((64, 64), 1.0, np.float32)
    cost[:, 32:] = -1
    cost[8:11, 8:11] = -1
    smooth = _with_short_outlines(cost)
    assert (smooth[:, :28] > 0).all()
    assert (smooth[:, 36:] < 0).all()
