"""The distribution of the dark counts of ordinary jots, beside exact sums of SciPy."""

import numpy as np
import pytest
from scipy.stats import betabinom, binom, geom

import jotlight as jl
from jotlight.calibration import Bulk


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frames", "mean"),
    [(1000, 0.01), (10**6, 1e-6), (10**6, 1e-4), (10**6, 0.3), (10**8, 0.5), (10**9, 1e-9)],
)
@pytest.mark.parametrize("rate", [1e-2, 1e-4, 1e-6])
def test_a_narrow_distribution_has_the_tail_of_the_binomial_one(frames, mean, rate):
    # With this spread, the smallest of a fit, the variance is larger by a factor of 1.001.
    bulk = Bulk(frames, mean, 1e-3 / frames)
    threshold = bulk.threshold(rate)
    exact = binom.isf(rate, frames, mean) + 1
    width = np.sqrt(frames * mean * (1 - mean))
    assert abs(threshold - exact) <= 5e-3 * width
    expected = binom.sf(threshold - 1, frames, mean)
    assert bulk.tail_probability(threshold) == pytest.approx(expected, rel=0.05)
    assert bulk.tail_probability(threshold) <= rate < bulk.tail_probability(threshold - 1)
    assert bulk.tail_probability(0) == pytest.approx(1, abs=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mean", "spread"), [(1e-4, 1e-2), (0.01, 0.1), (0.3, 10.0), (0.99, 3.0), (0.5, 1e-2)]
)
def test_a_wide_distribution_has_the_tail_of_the_exact_sum(mean, spread):
    frames = 200_000
    counts = np.arange(frames + 1)
    probabilities = betabinom.pmf(counts, frames, mean / spread, (1 - mean) / spread)
    tail = np.cumsum(probabilities[::-1])[::-1]
    bulk = Bulk(frames, mean, spread)
    for ones in (0, 1, 5, 3000, 70_001, 123_456):
        assert bulk.tail_probability(ones) == pytest.approx(tail[ones], rel=1e-3, abs=1e-30)
    for rate in (1e-1, 1e-2, 1e-4):
        expected = np.argmax(np.append(tail, 0) <= rate)
        assert abs(bulk.threshold(rate) - expected) <= 1
    part = probabilities[40:150_001].sum()
    assert bulk.log_mass(40, 150_000) == pytest.approx(np.log(part), abs=1e-5)


def test_weak_hot_jots_of_a_long_dark_capture_are_found():
    ones = np.random.default_rng(0).poisson(1.0, (64, 64))
    ones[5, 6], ones[50, 3] = 12, 15
    calibration = jl.calibrate(ones, frames=10**6)
    assert np.argwhere(calibration.hot).tolist() == [[5, 6], [50, 3]]


def test_hot_jots_are_found_where_nearly_all_counts_are_0():
    ones = np.zeros((100, 100), int)
    places = np.random.default_rng(5).permutation(ones.size)
    ones.flat[places[:120]] = np.repeat([1, 2, 900], 40)
    calibration = jl.calibrate(ones, frames=1000)
    assert calibration.hot_threshold <= 10
    assert np.array_equal(calibration.hot & (ones > 2), ones == 900)
    assert calibration.insufficient_frames_reason() is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("threshold", "rate", "frames", "share"),
    [(1, 1e-6, 200, 0.02), (1, 1e-5, 100, 0.1), (1, 1e-5, 100, 0.25), (3, 0.008, 2000, 0.01)],
)
def test_the_hot_jots_of_a_cooled_sensor_are_found(threshold, rate, frames, share):
    rng = np.random.default_rng(3)
    hot = rng.random((100, 100)) < share
    rates = np.where(hot, 10 ** rng.uniform(-2, 0, hot.shape), rate)
    ones = (rng.poisson(rates, (frames, *hot.shape)) >= threshold).sum(0)
    calibration = jl.calibrate(ones, frames=frames, threshold=threshold)
    # With 13 expected ones, a jot has 5 or more with a probability of 0.997.
    expected = frames * (rates if threshold == 1 else rates**3 / 6 * np.exp(-rates))
    strong = hot & (expected > 13)
    assert strong.sum() > 10
    assert calibration.hot[strong].mean() > 0.99
    assert not calibration.hot[~hot].any()


@pytest.mark.parametrize("mean", [0.05, 0.3])
def test_few_counts_of_rates_that_vary_by_their_mean_follow_the_geometric_distribution(mean):
    # A Poisson count whose rate is exponentially distributed is geometric.
    ones, frames = geom.rvs(1 / (1 + mean), loc=-1, size=40_000, random_state=4), 10**6
    bulk = jl.calibration.fit_bulk(ones, frames)
    error = np.sqrt(mean * (1 + mean) / len(ones))
    assert bulk.mean * frames == pytest.approx(mean, abs=4 * error)
    exact = geom.isf(1e-4, 1 / (1 + mean), loc=-1) + 1
    assert abs(bulk.threshold(1e-4) - exact) <= 1
