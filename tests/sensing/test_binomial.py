"""Fractions of ones: their stabilized noise."""

import numpy as np
import pytest

from jotlight.sensing.binomial import arcsin_root, squared_sine


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
