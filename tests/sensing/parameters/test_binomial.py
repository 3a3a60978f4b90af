"""Fractions of ones: limits of their probability, and their stabilized noise."""

import numpy as np
import pytest
from scipy.stats import binom

from jotlight.sensing.parameters.binomial import (
    arcsin_root,
    clopper_pearson,
    squared_sine,
    upper_limit,
    upper_tail,
)


@pytest.mark.parametrize("p", [0.0, 0.1, 0.8, 1.0])
def test_the_upper_tail_is_that_of_the_binomial_distribution(p):
    ones = np.arange(9)
    expected = binom.sf(ones - 1, 8, p)
    np.testing.assert_allclose(upper_tail(ones, 8 - ones, np.full(9, p)), expected, rtol=1e-12)


@pytest.mark.parametrize("p", [0.1, 0.5, 0.8])
def test_the_noise_of_the_angle_is_the_same_for_every_probability(p):
    fractions = np.random.default_rng(0).binomial(1000, p, 20_000) / 1000
    assert arcsin_root(fractions).var() == pytest.approx(1 / 4000, rel=0.05)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_squared_sine_is_the_inverse_and_types_stay(dtype):
    fractions = np.linspace(0, 1, 11, dtype=dtype)
    found = squared_sine(arcsin_root(fractions))
    assert found.dtype == dtype
    np.testing.assert_allclose(found, fractions, atol=1e-6)
    np.testing.assert_array_equal(
        arcsin_root(np.array([-0.1, 1.1])), arcsin_root(np.array([0.0, 1]))
    )


def test_the_tails_beyond_the_limits_have_the_stated_probability():
    ones, bits, tail = np.arange(11), np.full(11, 10), 0.02
    (low, above_low), (high, above_high) = clopper_pearson(ones, bits, tail, jots_differ=False)
    np.testing.assert_allclose(binom.cdf(ones[:-1], 10, high[:-1]), tail, rtol=1e-9)
    np.testing.assert_allclose(binom.sf(ones[1:] - 1, 10, low[1:]), tail, rtol=1e-9)
    assert (low[0], high[-1]) == (0, 1)
    np.testing.assert_allclose(low + above_low, 1)
    np.testing.assert_allclose(high + above_high, 1)


def test_the_upper_limit_keeps_the_digits_of_small_complements():
    limit, complement = upper_limit(np.array([10.0**9]), np.array([1.0]), 1e-6)
    assert complement[0] == pytest.approx(1e-15, rel=1e-3)
    assert limit[0] == 1 - complement[0]


@pytest.mark.parametrize("ones", [0.0, 0.4, 3.0])
def test_fewer_zeros_widen_the_interval(ones):
    zeros = np.array([0.0, 1e-6, 0.01, 0.1, 0.5, 0.9, 1.0, 1.1, 2.0, 9.0])
    _, (high, above_high) = clopper_pearson(
        np.full(10, ones), ones + zeros, 0.025, jots_differ=False
    )
    assert (high[0], above_high[0]) == (1, 0)
    assert (np.diff(high) <= 0).all()
    assert (np.diff(above_high[2:]) > 0).all()
    if ones == 0:
        np.testing.assert_allclose(above_high[2:], 0.025 ** (1 / zeros[2:]), rtol=1e-12)
