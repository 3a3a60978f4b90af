"""Random subsets of the bits of each pixel."""

import numpy as np
from scipy import stats

from jotlight.sensing.subsampling import subsample_counts

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
