"""Random maps of trials for training."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt
from scipy.stats import binom

from jotlight.estimators.trial_levels import level_weights, local_trials
from jotlight.training.trials_maps import (
    MAX_TRIALS,
    draw_counts,
    draw_trials_map,
    serving_weights,
)

SIDE = 40


def kind_of(trials, level):
    """Return which kind of map this is, from its values alone."""
    if (trials == 0).all(1).any() or (trials == 0).all(0).any():
        return "lines"
    if len(np.unique(trials)) == 2 and (trials > 0).all():
        return "border"
    return "jots" if np.median(trials) == level and trials.max() == level else "smooth"


def test_maps_hold_whole_numbers_and_all_kinds_occur():
    rng = np.random.default_rng(0)
    kinds = []
    for _ in range(200):
        trials = draw_trials_map(rng, SIDE, 20)
        assert trials.shape == (SIDE, SIDE)
        assert ((trials >= 0) & (trials == np.rint(trials))).all()
        assert ((trials > 10) & (trials < 40)).any()
        kinds.append(kind_of(trials, 20))
    for kind in ("lines", "border", "jots", "smooth"):
        low, high = binom.ppf([1e-6, 1 - 1e-6], 200, 1 / 4)
        # A border or a line outside the patch leaves a uniform map.
        assert low - 15 <= kinds.count(kind) <= high + 15


def test_maps_are_bounded():
    rng = np.random.default_rng(1)
    assert max(draw_trials_map(rng, 8, MAX_TRIALS).max() for _ in range(50)) == MAX_TRIALS


def test_counts_are_binomial_with_the_trials_of_their_pixel():
    rng = np.random.default_rng(2)
    trials = np.where(np.arange(300) < 150, 4.0, 64.0) * np.ones((300, 1))
    counts = draw_counts(rng, np.full(trials.shape, 0.3), trials, 16)
    for own in (4, 64):
        ones = counts[trials == own] * own / 16
        np.testing.assert_allclose(ones, np.rint(ones), atol=1e-4)
        total = own * ones.size
        low, high = binom.ppf([1e-6, 1 - 1e-6], total, 0.3)
        assert low <= ones.sum() <= high
        assert ones.var() == pytest.approx(own * 0.3 * 0.7, rel=0.05)


def test_pixels_without_trials_have_the_value_of_the_nearest_pixel():
    rng = np.random.default_rng(3)
    trials = np.where(rng.random((SIDE, SIDE)) < 0.3, 0.0, 9.0)
    counts = draw_counts(rng, rng.random(trials.shape), trials, 9)
    distances = distance_transform_edt(trials == 0)
    rows, columns = np.mgrid[:SIDE, :SIDE]
    for row, column in np.argwhere(trials == 0):
        away = np.hypot(rows - row, columns - column)
        nearest = (abs(away - distances[row, column]) < 1e-9) & (trials > 0)
        assert counts[row, column] in counts[nearest]
    np.testing.assert_array_equal(draw_counts(rng, np.ones((3, 3)), np.zeros((3, 3)), 8), 4)


def test_weights_are_those_with_which_a_reconstruction_uses_the_level():
    trials = np.where(np.arange(SIDE) < SIDE // 2, 100.0, 200.0) * np.ones((SIDE, 1))
    for level, weights in level_weights(local_trials(trials)):
        # Levels are rounded to whole numbers, so their ratios are not exactly the square root of 2.
        np.testing.assert_allclose(serving_weights(trials, level), weights, atol=0.02)


def test_a_level_does_not_serve_a_patch_without_trials():
    assert not serving_weights(np.zeros((4, 4)), 16).any()
    assert serving_weights(np.full((4, 4), 16.0), 16).all()
