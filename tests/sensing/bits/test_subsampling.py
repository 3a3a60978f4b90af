"""Random subsets of the bits of each pixel."""

import numpy as np
import pytest
from scipy import stats

from jotlight.sensing.bits.subsampling import draw_share, subsample_counts

FALSE_ALARMS = 1e-9
"""Probability that a correct program fails a statistical test."""


def test_subsampled_counts_are_hypergeometric():
    pixels, ones, trials, subset = 20_000, 5, 12, 7
    sampled = subsample_counts(
        np.full(pixels, ones), np.full(pixels, trials), np.full(pixels, subset), rng=0
    )
    probabilities = stats.hypergeom(trials, ones, subset).pmf(np.arange(ones + 1))
    histogram = np.bincount(sampled, minlength=ones + 1)
    assert len(histogram) == ones + 1
    for observed, p in zip(histogram, probabilities, strict=True):
        assert stats.binomtest(int(observed), pixels, p).pvalue > FALSE_ALARMS / (ones + 1)


def test_the_two_parts_of_binomial_bits_are_independent():
    """Their joint distribution is the product of two binomial distributions."""
    pixels, p = 20_000, 0.3
    ones = np.random.default_rng(1).binomial(8, p, pixels)
    first = subsample_counts(ones, np.full(pixels, 8), np.full(pixels, 5), rng=2)
    table = np.histogram2d(first, ones - first, bins=[np.arange(-0.5, 6), np.arange(-0.5, 4)])[0]
    expected = np.outer(stats.binom(5, p).pmf(np.arange(6)), stats.binom(3, p).pmf(np.arange(4)))
    for observed, joint in zip(table.ravel(), expected.ravel(), strict=True):
        assert stats.binomtest(int(observed), pixels, joint).pvalue > FALSE_ALARMS / table.size


@pytest.mark.parametrize(
    ("ones", "zeros", "subset"),
    [(2 * 10**9, 3, 10**9), (3, 2 * 10**9, 10**9), (10**9, 5 * 10**8, 4), (10**9, 10**9, 7)],
)
def test_more_bits_than_numpy_takes_have_the_same_distribution(ones, zeros, subset):
    pixels = 20_000
    sampled = subsample_counts(
        np.full(pixels, ones), np.full(pixels, ones + zeros), np.full(pixels, subset), rng=3
    )
    low, high = max(0, subset - zeros), min(ones, subset)
    assert low <= sampled.min() <= sampled.max() <= high
    # With 10^9 bits or more, draws with and without replacement hardly differ.
    few = min(zeros, ones) < 10
    number, p = (3, subset / (ones + zeros)) if few else (subset, ones / (ones + zeros))
    picked = subset - sampled if few and zeros < ones else sampled
    for value in range(number + 1):
        observed = int((picked == value).sum())
        expected = stats.binom(number, p).pmf(value)
        assert stats.binomtest(observed, pixels, expected).pvalue > FALSE_ALARMS


def test_the_variance_of_large_draws_is_hypergeometric():
    pixels, ones, zeros, subset = 20_000, 12 * 10**8, 9 * 10**8, 10**9
    sampled = subsample_counts(
        np.full(pixels, ones), np.full(pixels, ones + zeros), np.full(pixels, subset), rng=4
    )
    total, share = ones + zeros, ones / (ones + zeros)
    # That of binomial draws would be twice as large.
    variance = subset * share * (1 - share) * (total - subset) / (total - 1)
    assert np.var(sampled) == pytest.approx(variance, rel=0.06)
    assert np.mean(sampled) == pytest.approx(subset * share, abs=6 * np.sqrt(variance / pixels))


def test_pixels_with_many_and_with_few_bits_are_drawn_together():
    ones, trials = np.array([[2**31 - 1, 8, 0]]), np.array([[2**31 - 1, 8, 2**31 - 1]])
    subset = np.array([[2**30, 3, 5]])
    assert subsample_counts(ones, trials, subset, rng=0).tolist() == [[2**30, 3, 0]]
    with pytest.raises(ValueError, match="ones, subset: expected at most"):
        subsample_counts(ones, trials, trials + 1, rng=0)


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_share_of_fractional_trials_has_as_many_zeros_as_the_rest(share):
    pixels = 20_000
    trials = np.full(pixels, 3.4)
    ones, number = draw_share(np.full(pixels, 3), trials, share, np.random.default_rng(5))
    zeros = number - ones
    assert set(np.unique(zeros)) == {0.0, trials[0] - 3}
    assert stats.binomtest(int((zeros > 0).sum()), pixels, share).pvalue > FALSE_ALARMS
    assert abs(ones.mean() - 3 * share) < 0.02


def test_a_share_of_whole_trials_takes_no_further_random_numbers():
    ones, trials = np.full(100, 3), np.full(100, 8.0)
    rng = np.random.default_rng(6)
    subset = np.floor(0.2 * trials + rng.random(100)).astype(int)
    expected = subsample_counts(ones, trials, subset, rng)
    drawn, number = draw_share(ones, trials, 0.2, np.random.default_rng(6))
    np.testing.assert_array_equal(drawn, expected)
    np.testing.assert_array_equal(number, subset)
