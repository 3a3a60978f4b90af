"""The K-conditioned network for maps of trials, and for more trials than it knows."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.trial_levels import local_trials
from jotlight.networks.inference.trials_map import denoise_fractions, denoise_map
from reference import trials_map as reference

NETWORK = jl.pretrained(jl.Sensor())
IMAGE = jl.datasets.photograph()[100:196, 200:328]


def draw(trials, rng=0):
    p = 1 - np.exp(-0.5 * IMAGE)
    ones = np.random.default_rng(rng).binomial(trials, p)
    return ones.astype(np.float32), np.broadcast_to(np.float32(trials), IMAGE.shape), p


def psnr(estimate, truth):
    return float(jl.metrics.psnr(estimate, truth))


@pytest.mark.parametrize("trials", [1, 7, 256])
def test_equal_trials_are_one_call_of_the_network(trials):
    ones, trials_map, _ = draw(trials)
    expected = np.clip(NETWORK.denoise_probability(ones / np.float32(trials), trials), 0, 1)
    np.testing.assert_allclose(denoise_map(NETWORK, ones, trials_map), expected, atol=1e-6)


def test_trials_between_two_levels_are_interpolated():
    trials = np.where(np.arange(128) < 64, 8, 16) * np.ones((96, 1), int)
    ones, trials_map, truth = draw(trials)
    mixed = denoise_map(NETWORK, ones, trials_map)
    fraction = ones / trials_map
    left, right = (NETWORK.denoise_probability(fraction, level) for level in (8, 16))
    np.testing.assert_allclose(mixed[:, :50], np.clip(left, 0, 1)[:, :50], atol=1e-6)
    np.testing.assert_allclose(mixed[:, 78:], np.clip(right, 0, 1)[:, 78:], atol=1e-6)
    trials_map = np.full(IMAGE.shape, 14, np.float32)
    trials_map[:, :64] = 8
    trials_map[:, 120:] = 16
    # The levels are 8, 11, and 16.
    weight = 2 * np.log2(14 / 11) / np.log2(16 / 11) - 1
    expected = (1 - weight) * NETWORK.denoise_probability(fraction, 11) + weight * right
    middle = (slice(None), slice(74, 110))
    fraction_map = (fraction * trials_map).astype(np.float32)
    found = denoise_map(NETWORK, fraction_map, trials_map)
    np.testing.assert_allclose(found[middle], np.clip(expected, 0, 1)[middle], atol=3e-4)
    assert psnr(mixed, truth) > 28


def test_a_level_that_only_a_corner_needs_hardly_changes_where_it_runs_there_alone():
    """The engine runs a level only where pixels need it, and the twin everywhere."""
    trials = np.full(IMAGE.shape, 64)
    trials[:20, :20] = 8
    ones, trials_map, _ = draw(trials)
    difference = denoise_map(NETWORK, ones, trials_map) - reference.denoise_map(
        NETWORK, ones, trials_map
    )
    assert abs(difference).max() < 6e-3
    assert np.sqrt(np.mean(difference**2)) < 2e-4


COLUMNS = np.arange(128)
FEW = np.random.default_rng(6).random((96, 128)) < 0.001
MAPS = {
    "two": np.where(COLUMNS < 50, 8, 64),
    "close to 3": np.where(COLUMNS < 50, 3, 30),
    "close to 5": np.where(COLUMNS < 50, 5, 47),
    "a gradient": np.geomspace(3, 200, 128).astype(int),
    "a few with fewer": np.where(FEW, 8, np.where(COLUMNS < 50, 90, 200)),
    "most with nearly all": np.where(COLUMNS < 5, 100, np.where(COLUMNS < 110, 256, 244)),
    "beyond the range": np.where(COLUMNS < 50, 200, 5000),
    "far beyond": np.where(COLUMNS < 50, 700, 20_000),
}


@pytest.mark.parametrize("name", MAPS)
def test_maps_of_trials_agree_with_the_twin(name):
    ones, trials_map, _ = draw(MAPS[name] * np.ones((96, 1), int))
    found = denoise_map(NETWORK, ones, trials_map)
    expected = reference.denoise_map(NETWORK, ones, trials_map)
    # The halos of the engine are a third of the receptive field, at a long border here. The
    # differences are proportional to the noise.
    noise = 0.5 / np.sqrt(MAPS[name].min())
    assert abs(found - expected).max() < 0.08 * noise
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.004 * noise


def test_images_that_share_a_map_are_those_of_separate_calls():
    trials = [
        local_trials(np.where(np.arange(48) < n, 8.0, 90.0) * np.ones((40, 1))) for n in (9, 30)
    ]
    fractions = np.random.default_rng(4).random((6, 40, 48), np.float32)
    own = [trials[0], 17, trials[1], trials[0], 17, 3000]
    together = denoise_fractions(NETWORK, fractions, own)
    for image, each, found in zip(fractions, own, together, strict=True):
        (alone,) = denoise_fractions(NETWORK, image[None], [each])
        np.testing.assert_array_equal(found, alone)


def test_the_number_of_threads_does_not_change_a_map_of_trials():
    ones, trials, _ = draw(np.where(np.eye(96, 128, 20) > 0, 2, 700))
    one = denoise_map(NETWORK, ones, trials, threads=1)
    np.testing.assert_array_equal(denoise_map(NETWORK, ones, trials, threads=3), one)


def test_pixels_without_trials_get_the_value_of_their_neighbors():
    ones, trials, truth = draw(64)
    trials, ones = trials.copy(), ones.copy()
    trials[40:44, 50:53] = ones[40:44, 50:53] = 0
    estimate = denoise_map(NETWORK, ones, trials)
    assert np.isfinite(estimate).all()
    assert abs(estimate - truth)[40:44, 50:53].mean() < 0.1
    np.testing.assert_array_equal(denoise_map(NETWORK, 0 * ones, 0 * trials), 0.5)


@pytest.mark.parametrize(
    ("trials", "gain_of_network", "gain_of_counts"),
    [(600, 1.2, 5), (1000, 2.5, 5), (4000, 6, 3), (16_000, 9, 0.5)],
)
def test_more_trials_than_the_network_knows_improve_the_image(
    trials, gain_of_network, gain_of_counts
):
    ones, trials_map, truth = draw(trials)
    quality = psnr(denoise_map(NETWORK, ones, trials_map), truth)
    network = np.clip(NETWORK.denoise_probability(ones / trials_map, 256), 0, 1)
    assert quality > psnr(network, truth) + gain_of_network
    assert quality > psnr(ones / trials_map, truth) + gain_of_counts
