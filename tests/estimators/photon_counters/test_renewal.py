"""The number of detections: sums over probable numbers are those over all numbers."""

import mpmath as mp
import numpy as np
import pytest
from scipy.special import gammainc

from jotlight.estimators.photon_counters.renewal import Renewal


def chances(dead_time, rate, digits):
    """Return P(N ≥ n) and its derivative by the rate for all n from 0, by mpmath."""
    with mp.workdps(digits):
        tau, r = mp.mpf(dead_time), mp.mpf(rate)
        rests = [1 - (n - 1) * tau for n in range(1, int(np.ceil(1 / dead_time)) + 1)]
        tails = [mp.gammainc(n, 0, r * u, regularized=True) for n, u in enumerate(rests, 1)]
        slopes = [
            u * (r * u) ** (n - 1) * mp.exp(-r * u) / mp.factorial(n - 1)
            for n, u in enumerate(rests, 1)
        ]
        return [mp.mpf(1), *tails, mp.mpf(0)], [mp.mpf(0), *slopes, mp.mpf(0)]


@pytest.mark.parametrize("rate", [0.01, 2.0, 60.0, 300.0])
@pytest.mark.parametrize("dead_time", [0.3, 0.017])
def test_mean_and_information_are_those_of_mpmath(dead_time, rate):
    tails, slopes = chances(dead_time, rate, 300)
    with mp.workdps(300):
        mean = sum(tails[1:])
        information = sum(
            (slopes[n] - slopes[n + 1]) ** 2 / (tails[n] - tails[n + 1])
            for n in range(len(tails) - 1)
        )
    renewal = Renewal(dead_time)
    assert renewal.mean(np.array(rate)) == pytest.approx(float(mean), rel=1e-12)
    expected = pytest.approx(float(information), rel=1e-8)
    assert renewal.information(np.array(rate)) == expected


@pytest.mark.parametrize("rate", [5.0, 400.0, 1e4, 1e6])
def test_numbers_outside_the_sums_do_not_matter(rate):
    dead_time, step = 1e-3, 1e-4
    n = np.arange(1, 1001)
    rest = 1 - (n - 1) * dead_time
    # Sums over all numbers, with numeric derivatives.
    levels = rate * np.array([1 - step, 1, 1 + step])[:, None]
    tails = np.pad(gammainc(n, levels * rest), ((0, 0), (1, 1)), constant_values=((0, 0), (1, 0)))
    renewal = Renewal(dead_time)
    assert renewal.mean(np.array(rate)) == pytest.approx(tails[1, 1:].sum(), rel=1e-9)
    weights = -np.diff(tails, axis=1)
    usable = weights[1] > 1e-12
    slope = (weights[2] - weights[0])[usable] / (2 * step * rate)
    expected = np.sum(slope**2 / weights[1][usable])
    assert renewal.information(np.array(rate)) == pytest.approx(expected, rel=1e-4)


def test_short_dead_times_approach_their_limits():
    rate, dead_time = 4e4, 1e-6
    renewal = Renewal(dead_time)
    loss = 1 + rate * dead_time
    assert renewal.mean(np.array(rate)) == pytest.approx(rate / loss, rel=1e-6)
    # The counts approach a normal distribution of the variance r/(1 + r τ)³.
    assert renewal.information(np.array(rate)) == pytest.approx(1 / rate / loss, rel=1e-4)


def test_maps_of_rates_keep_their_shape():
    renewal, rates = Renewal(0.01), np.array([[3.0, 50.0, 3.0], [50.0, 0.0, 1e9]])
    for values in (renewal.mean(rates), renewal.information(rates)):
        assert values.shape == rates.shape
        assert values[0, 0] == values[0, 2]
        assert values[0, 1] == values[1, 0]
    assert renewal.mean(rates)[1].tolist()[1:] == [0.0, 100.0]
    assert renewal.mean(np.zeros((0, 4))).shape == (0, 4)
