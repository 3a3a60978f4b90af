"""Smooth curves: what they keep, and how much noise they remove."""

import numpy as np
import pytest
from scipy.linalg import eigh

from jotlight.motion.displacements.smoothing import (
    _PENALTIES,
    _TOLERANCE,
    cubic_weights,
    interpolation_bias,
    smoothing_matrix,
)


def slow_smoothing(series, information):
    """Return the smoothest curve whose residuals are like noise, by solving each system."""
    number = len(series)
    weight = np.diag(information)
    differences = np.diff(np.eye(number), 3, axis=0)
    # Independent components, from the smoothest to the roughest. Those of noise have variance 1.
    modes = eigh(differences.T @ differences, weight)[1]
    rough = ((modes.T @ weight @ series) ** 2)[number // 2 :].mean()
    excess = min(max(rough, 1), 10)
    smooth = series
    for penalty in _PENALTIES:
        matrix = np.linalg.solve(
            weight + penalty * information.mean() * differences.T @ differences, weight
        )
        residuals = np.sqrt(information)[:, None] * (series - matrix @ series)
        roots = np.sqrt(information)
        whitened = np.eye(number) - roots[:, None] * matrix / roots
        if (residuals**2).sum() > _TOLERANCE * excess * series.shape[1] * (whitened**2).sum():
            break
        smooth = matrix @ series
    return smooth


@pytest.mark.parametrize("seed", range(5))
def test_curves_are_those_of_a_slow_solution(seed):
    rng = np.random.default_rng(seed)
    places = np.arange(24.0)[:, None]
    information = rng.uniform(0.3, 3, 24)
    series = 20 * np.sin(places / rng.uniform(3, 9) + [0, 1]) / np.array([1, 2])
    series += rng.normal(size=(24, 2)) / np.sqrt(information)[:, None]
    found = smoothing_matrix(series, information) @ series
    np.testing.assert_allclose(found, slow_smoothing(series, information), atol=1e-3)


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5, 40])
def test_parabolas_keep_their_values(number):
    places = np.arange(float(number))
    series = np.stack([3 + 0.5 * places - 0.1 * places**2, places], axis=1)
    smooth = smoothing_matrix(series, np.random.default_rng(0).uniform(0.1, 2, number)) @ series
    np.testing.assert_allclose(smooth, series, atol=1e-7)


def test_noise_is_averaged_over_many_blocks():
    noise = np.random.default_rng(0).normal(size=(32, 6))
    weights = smoothing_matrix(noise, np.ones(32))
    assert (weights[16] ** 2).sum() < 0.12  # the value alone would have 1
    np.testing.assert_allclose(weights.sum(axis=1), 1)


def test_fast_changes_are_followed():
    series = 5 * np.sin(2 * np.pi * np.arange(32.0) / 10)[:, None] / 0.01
    smooth = smoothing_matrix(series, np.ones(32)) @ series
    np.testing.assert_allclose(0.01 * smooth, 0.01 * series, atol=0.05)


def test_values_without_information_are_interpolated():
    series = np.arange(20.0)[:, None] ** 2
    damaged, information = series.copy(), np.ones(20)
    damaged[7], information[7] = 1000, 0
    smooth = smoothing_matrix(damaged, information) @ damaged
    np.testing.assert_allclose(smooth, series, atol=0.1)
    assert np.isfinite(smoothing_matrix(series, np.zeros(20))).all()


@pytest.mark.parametrize("place", [0.0, 0.4, 3.3, 15.5, 30.9, 31.0])
def test_weights_interpolate_cubics(place):
    places = np.arange(32.0)
    weights = cubic_weights(32, place)
    for power in range(4):
        assert weights @ places**power == pytest.approx(place**power, abs=1e-6)
    assert np.count_nonzero(weights) <= 4


@pytest.mark.parametrize("number", [1, 2, 3])
def test_fewer_than_four_values_have_weights_too(number):
    weights = cubic_weights(number, 0.5)
    assert weights.shape == (number,)
    for power in range(number):
        assert weights @ np.arange(float(number)) ** power == pytest.approx(0.5**power)


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 7, 31])
def test_biased_values_of_a_parabola_are_right_on_the_mean_of_a_block(frames):
    """Linear interpolation between them has the mean of the parabola over all frames."""
    blocks = np.arange(5)
    centers = blocks * frames + (frames - 1) / 2
    values = (centers / frames) ** 2 - interpolation_bias(frames) * 2
    inside = np.arange(2 * frames, 3 * frames)
    interpolated = np.interp(inside, centers, values)
    assert interpolated.mean() == pytest.approx(np.mean((inside / frames) ** 2))


@pytest.mark.parametrize("place", [0.0, 0.4, 3.3, 15.5, 31.0])
def test_weights_undo_the_bias_of_cubics(place):
    places = np.arange(-2.0, 34.0)
    for power in range(4):
        curve = places**power
        values = curve[1:-1] - 0.08 * np.diff(curve, 2)
        found = cubic_weights(34, place + 1, 0.08) @ values
        assert found == pytest.approx(place**power, abs=1e-5)
