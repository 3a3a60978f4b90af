"""The most likely rates of decays are the best maximum, and fast decays are found."""

import numpy as np
import pytest
from scipy import optimize, stats

from jotlight.estimators.photon_counters.decays import Gates, decay_rates


def drawn(times, light, rate, dark, readings, pixels, seed):
    """Return the gates of simulated pixels."""
    expected = light * np.exp(-rate * times) + dark
    shape = (len(times), pixels)
    ones = np.random.default_rng(seed).binomial(readings, -np.expm1(-expected)[:, None], shape)
    return Gates(ones.astype(float), np.full(shape, float(readings)), times, np.full(shape, dark))


@pytest.mark.slow
def test_weak_light_over_dark_counts_has_the_best_maximum_of_many_searches():
    times = np.linspace(0, 1, 12)
    gates = drawn(times, 0.1, 3.3, 0.05, 100, 12, seed=0)
    rates = decay_rates(gates)
    for ones, rate in zip(gates.ones.T, rates, strict=True):

        def cost(point, ones=ones):
            light = np.exp(np.clip(point[0] - point[1] * times, -300, 300))
            return -stats.binom.logpmf(ones, 100, -np.expm1(-light - 0.05)).sum()

        starts = [(a, r) for a in (-4.0, -1.0) for r in (0.0, 4.0, 20.0)]
        searches = [
            optimize.minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-8})
            for start in starts
        ]
        best = min(searches, key=lambda each: each.fun)
        assert rate == pytest.approx(best.x[1], rel=1e-3)


def test_strong_dark_counts_do_not_hide_the_best_maximum():
    # Another maximum, at a rate of 4.6, has a log-likelihood of -193.552.
    times = np.array([0, 0.3, 0.9, 1.0, 2.5, 4]) / 4
    ones = np.array([96.0, 87, 94, 88, 87, 88])[:, None]
    gates = Gates(ones, np.full((6, 1), 100.0), times, np.full((6, 1), 2.0))
    rate = decay_rates(gates)
    likelihoods = [gates.log_likelihood(np.array([[a], rate]))[0] for a in np.linspace(-3, 3, 601)]
    assert max(likelihoods) == pytest.approx(-193.345, abs=1e-3)


def test_maxima_over_dark_counts_are_those_of_a_dense_grid():
    times = np.linspace(0, 1, 12)
    gates = drawn(times, 0.3, 5.0, 1.0, 100, 200, seed=3)
    rates = decay_rates(gates)
    gates, rates = gates.at(np.flatnonzero(rates > 0)), rates[rates > 0]

    def highest(rate, amplitudes):
        points = (np.stack([np.full(rate.shape, a), rate]) for a in amplitudes)
        return np.max([gates.log_likelihood(point) for point in points], axis=0)

    grid = [highest(np.full(rates.shape, r), np.linspace(-9, 3, 49)) for r in np.arange(0, 44, 0.5)]
    found = highest(rates, np.linspace(-9, 3, 481))
    assert len(rates) > 150
    assert (found > np.max(grid, axis=0) - 0.01).all()


@pytest.mark.parametrize("gate_widths", [0.4, 1.0, 40.0])
def test_lifetimes_of_parts_of_a_gate_and_of_many_gates_are_found(gate_widths):
    times = np.linspace(0, 1, 256)
    rate = 255 / gate_widths
    rates = decay_rates(drawn(times, 0.5, rate, 0.001, 1000, 400, seed=1))
    assert np.isfinite(rates).all()
    assert np.median(rates) == pytest.approx(rate, rel=0.02)


def test_light_that_rises_has_a_negative_rate():
    ones = 1e9 * -np.expm1(-0.1 * np.exp(np.array([[0.0], [1.0], [2.0]])))
    times, dark = np.array([0, 0.5, 1]), np.zeros((3, 1))
    found = decay_rates(Gates(ones, np.full((3, 1), 1e9), times, dark))
    assert found == pytest.approx(-2.0, rel=1e-6)


def test_pixels_without_a_rate_are_nan():
    # No light beyond the dark counts, one gate with ones, and only ones.
    ones = np.array([[1, 2, 1], [0, 5, 0], [9, 9, 9]], float).T
    gates = Gates(ones, np.full((3, 3), 9.0), np.array([0, 0.5, 1]), np.full((3, 3), 3.0))
    assert np.isnan(decay_rates(gates)).all()
