"""Methods that run at some levels of the number of trials."""

import numpy as np
import pytest

from jotlight._engine import level_weights as level_weights_of_maps
from jotlight.estimators.trial_levels import (
    count_local_trials,
    fill_from_nearest,
    interpolate_levels,
    local_trials,
)
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.sensor import Sensor


def level_weights(trials):
    """Return the levels of one map, and their weights."""
    return level_weights_of_maps([trials.astype(np.float32)])[0]


def test_levels_that_few_pixels_need_are_left_out():
    trials = np.full((100, 200), 128.0)
    trials[0, :13] = np.geomspace(8, 120, 13)
    trials[50:] = 200.0
    weights = dict(level_weights(trials))
    # The ratio of neighbors is 4 at most. The pixel with 8 trials has the lowest level, too.
    assert sorted(weights) == [9, 35, 100, 141, 200]
    np.testing.assert_allclose(sum(weights.values()), 1, atol=1e-6)
    for level, weight in weights.items():
        # No other pixel has a level above its trials alone.
        assert (trials[weight == 1] >= (level if level > 9 else 8)).all()


def test_pixels_halfway_between_two_levels_are_interpolated_by_the_logarithm():
    trials = np.random.default_rng(0).uniform(0.5, 90, (20, 30))
    levels = [1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64, 90]
    calls = []

    def run(level, images):
        calls.append(level)
        return np.full((len(images), *trials.shape), np.log2(level), np.float32)

    (found,) = interpolate_levels(run, [trials], trials.shape)
    assert calls == levels
    for place, value in np.ndenumerate(np.log2(np.maximum(trials, 1))):
        upper = int(np.searchsorted(np.log2(levels), value))
        low, high = np.log2(levels[max(upper - 1, 0) : upper + 1])[[0, -1]]
        # The second half of the way between two levels is stretched to all of it.
        share = np.clip(2 * (value - low) / max(high - low, 1e-9) - 1, 0, 1)
        assert found[place] == pytest.approx(low + share * (high - low), abs=1e-5)
    weights = [weight for _, weight in level_weights(trials)]
    np.testing.assert_allclose(np.sum(weights, axis=0), 1, atol=1e-6)
    assert (np.array(weights) > 0).sum(axis=0).max() == 2


def test_one_level_serves_most_pixels_if_a_few_of_their_bits_are_left_out():
    rng = np.random.default_rng(5)
    trials = 256.0 - rng.integers(0, 20, (40, 50)) * (rng.random((40, 50)) < 0.1)
    ((level, weights),) = level_weights(np.maximum(trials, 240))
    assert level == 240
    np.testing.assert_array_equal(weights, 1)
    # If other pixels have fewer, too, only these have other levels.
    trials[:, :5] = 100
    found = dict(level_weights(trials))
    assert max(found) == 230
    np.testing.assert_array_equal(found[230][:, 5:], 1)
    # Without pixels between, the largest level is exact.
    assert max(dict(level_weights(np.where(trials > 100, 256.0, 100.0)))) == 256


def test_a_level_without_a_pixel_is_not_run_and_images_share_the_others():
    trials = np.where(np.eye(8, dtype=bool), 1.0, 64.0)
    calls = []

    def run(level, images):
        calls.append((level, images))
        return np.full((len(images), 8, 8), level, np.float32)

    found = interpolate_levels(run, [trials, 7, trials.copy(), 64, 7], (8, 8))
    assert calls == [(1, [0, 2]), (7, [1, 4]), (64, [0, 2, 3])]
    np.testing.assert_array_equal(found[[0, 2]], [trials, trials])
    np.testing.assert_array_equal(found[[1, 3, 4], 0, 0], [7, 64, 7])


def test_unknown_pixels_get_the_value_of_the_nearest():
    values = np.random.default_rng(1).random((12, 9))
    known = np.random.default_rng(2).random((12, 9)) < 0.2
    filled = fill_from_nearest(values, known)
    places = np.argwhere(known)
    for place in np.ndindex(values.shape):
        distances = ((places - place) ** 2).sum(1)
        nearest = places[distances == distances.min()]
        assert np.float32(filled[place]) in [np.float32(values[tuple(each)]) for each in nearest]


def test_local_trials_are_the_harmonic_mean_of_a_neighborhood():
    trials = np.random.default_rng(3).choice([4.0, 64.0], (40, 50))
    trials[:, :25] = 64
    distance = np.arange(-9, 10)
    weight = np.exp(-(distance**2) / 18)
    weights = np.outer(weight, weight) / weight.sum() ** 2
    found = local_trials(trials)
    for row, column in [(20, 20), (15, 25), (25, 38)]:
        window = trials[row - 9 : row + 10, column - 9 : column + 10]
        assert found[row, column] == pytest.approx(1 / (weights / window).sum(), rel=1e-4)


def test_nearly_equal_trials_are_one_number():
    rng = np.random.default_rng(4)
    jots = rng.random((100, 120, 16)) > 0.05
    assert local_trials(4.0 * jots.sum(-1)) in (60, 61)
    assert local_trials(np.full((9, 9), 0.2)) == 1
    assert local_trials(np.full((9, 9), 1e5)) == 100_000
    ramp = np.linspace(11, 13, 100) * np.ones((8, 1))
    assert local_trials(ramp) == 12
    assert isinstance(local_trials(2 * ramp - 10), np.ndarray)


@pytest.mark.parametrize("trials", [[[[0, 0]]], [[[1, 0]], [[0, 0]]]])
def test_without_a_valid_pixel_an_image_has_no_trials(trials):
    trials = np.array(trials, float)
    pixels = PixelCounts(Sensor(), np.zeros(trials.shape, np.int32), trials, 1.0, 0.0, False)
    with pytest.raises(ValueError, match="at least one pixel with a valid bit"):
        count_local_trials(pixels)
