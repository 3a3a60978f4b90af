"""The scale of errors: its terms, the division of bits, and the correction by held-out bits."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import binom

from jotlight.evaluation.intervals.error_scale import (
    ErrorModel,
    HalfErrors,
    combine_dim,
    correction,
    divide_bits,
    error_model,
    error_terms,
    expected_squares,
    gray_scale,
)

RANDOM = np.random.default_rng(0)


def test_the_terms_are_products_of_six_numbers():
    z = RANDOM.uniform(0.1, 1.4, (9, 21))
    trials = RANDOM.integers(1, 50, z.shape).astype(float)
    terms = np.stack(list(error_terms(z, trials)), axis=-1)
    assert terms.shape == (9, 21, 28)
    row, column = 4, 7
    logs = []
    for side in (3, 15):
        padded = np.pad(z, side // 2, mode="reflect")
        window = padded[row : row + side, column : column + side]
        logs.append(np.log(window.var() * trials[row, column] + 0.01) / 2)
    value, number = z[row, column], trials[row, column]
    expected = [
        np.log(number) / 3,
        *logs,
        2 * value,
        np.log(1 + number * np.sin(value) ** 2) / 3,
        np.log(1 + number * np.cos(value) ** 2) / 3,
    ]
    np.testing.assert_allclose(terms[row, column, 0], 1)
    np.testing.assert_allclose(terms[row, column, 1:7], expected, rtol=1e-8)
    pairs = [a * b for i, a in enumerate(expected) for b in expected[i:]]
    np.testing.assert_allclose(terms[row, column, 7:], pairs, rtol=1e-8)
    # Other numbers join the products.
    other = RANDOM.random(z.shape)
    more = np.stack(list(error_terms(z, trials, other)), axis=-1)
    assert more.shape == (9, 21, 36)
    np.testing.assert_allclose(more[row, column, 7], other[row, column])
    np.testing.assert_allclose(more[row, column, -1], other[row, column] ** 2)


def test_both_halves_are_captures_with_half_of_the_trials():
    ones, trials = RANDOM.binomial(9, 0.3, (200, 200)).astype(np.int32), np.full((200, 200), 9.0)
    first, second = divide_bits(ones, trials)
    np.testing.assert_array_equal(first.ones + second.ones, ones)
    np.testing.assert_array_equal(first.trials + second.trials, 9)
    assert set(np.unique(first.trials)) == {4, 5}
    rates = first.ones / first.trials, second.ones / second.trials
    assert abs(np.mean(rates[0] - 0.3)) < 5 * np.sqrt(0.21 / 4 / ones.size)
    # Independent halves: the covariance of two binomial fractions is 0.
    noise = np.sqrt(0.21 / 4 * 0.21 / 4 / ones.size)
    assert abs(np.mean((rates[0] - 0.3) * (rates[1] - 0.3))) < 5 * noise


def test_fractional_trials_and_dead_pixels_are_divided():
    trials = np.array([[0.0, 2.5, 1.0]])
    first, second = divide_bits(np.array([[0, 2, 1]]), trials)
    np.testing.assert_array_equal(first.trials + second.trials, [[0, 2, 1]])


@pytest.mark.parametrize("number", [2, 8])
def test_squared_errors_are_unbiased(number):
    p, f = 0.4, 0.3
    shape = 400, 400
    held_out = RANDOM.binomial(number, p, shape)
    half = dataclasses.make_dataclass("H", ["ones", "trials"])
    trained = half(np.zeros(shape, int), np.full(shape, number))
    errors = HalfErrors.measure(
        np.full(shape, np.arcsin(np.sqrt(f))), trained, half(held_out, np.full(shape, number))
    )
    assert errors.known.all()
    deviation = errors.squared.std() / np.sqrt(errors.squared.size)
    assert abs(errors.squared.mean() - (p - f) ** 2) < 5 * deviation


def test_one_held_out_bit_shows_no_error():
    shape = 3, 4
    first, second = divide_bits(np.ones(shape, np.int32), np.full(shape, 2.0))
    errors = HalfErrors.measure(np.full(shape, 0.5), first, second)
    np.testing.assert_array_equal(errors.known, second.trials >= 2)


@pytest.fixture
def constant():
    """Return a model whose scale is 0.05 everywhere."""
    weights = np.zeros(28)
    weights[0] = np.log(0.05)
    return dataclasses.replace(error_model(), weights=weights, deviation=np.ones(8))


def measured(scale, shape, trials=64):
    """Return errors of estimates whose z deviates from the truth by `scale`."""
    truth = np.linspace(0.5, 1.0, shape[1]) * np.ones(shape)
    z = truth + scale * RANDOM.standard_normal(shape)
    ones = RANDOM.binomial(2 * trials, np.sin(truth) ** 2).astype(np.int32)
    first, second = divide_bits(ones, np.full(shape, 2.0 * trials))
    return HalfErrors.measure(z, first, second), z


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_the_correction_is_the_ratio_of_measured_and_expected_errors(constant, factor):
    errors, z = measured(0.05 * factor, (300, 300))
    found = correction([errors], [expected_squares(constant, errors)], z)
    assert np.median(found) == pytest.approx(factor, rel=0.06)


def test_few_pixels_change_the_scale_little(constant):
    errors, z = measured(0.05, (6, 7), trials=2)
    found = correction([errors], [expected_squares(constant, errors)], z)
    assert np.all((found > 0.6) & (found < 1.6))


def test_without_known_errors_there_is_no_correction(constant):
    errors, z = measured(0.05, (6, 7))
    errors = dataclasses.replace(errors, known=np.zeros((6, 7), bool))
    expected = expected_squares(constant, errors)
    np.testing.assert_array_equal(correction([errors], [expected], z), 1)


def test_a_written_model_is_read_again(tmp_path):
    error_model().write(tmp_path / "model.json")
    again = ErrorModel.read(tmp_path / "model.json")
    for name, values in dataclasses.asdict(error_model()).items():
        np.testing.assert_array_equal(getattr(again, name), values)


def test_quantiles_widen_with_the_coverage_and_surround_0():
    z, trials = RANDOM.uniform(0, 1.5, (5, 6)), np.full((5, 6), 16.0)
    previous = np.zeros(z.shape), np.zeros(z.shape)
    for tail in (0.25, 0.1, 0.05, 0.01, 0.0025):
        low, high = error_model().quantiles(z, trials, tail)
        assert (low < previous[0]).all()
        assert (high > previous[1]).all()
        previous = low, high


def test_the_quantiles_depend_on_the_activity(constant):
    """Between the activities of two classes, they are linear."""
    tails = np.array([0.01, 0.25])
    low = np.stack([np.full((8, 2), -activity) for activity in (1.0, 3.0)], axis=1)
    nodes = np.tile([-2.0, 2.0], (8, 1))
    model = dataclasses.replace(constant, tails=tails, activity=nodes, low=low, high=-2 * low)
    # Stripes with a deviation of 0.1 in nearly all windows.
    z = 0.8 + 0.1 * np.where(np.arange(64) % 2, 1, -1) * np.ones((64, 64))
    for trials, activity in ((1e-6, -2.0), (100.0, 0.0), (1e9, 2.0)):
        lower, upper = model.quantiles(z, np.full(z.shape, trials), 0.05)
        expected = 2 + activity / 2
        np.testing.assert_allclose(lower, -expected, atol=0.02)
        np.testing.assert_allclose(upper, 2 * expected, atol=0.04)


def test_dim_scenes_have_the_scale_of_combined_trials(constant):
    z, trials = RANDOM.uniform(0.01, 0.02, (30, 40)), np.full((30, 40), 4096.0)
    combined, number, factor = combine_dim(z, trials)
    assert factor > 10
    np.testing.assert_allclose(np.sin(combined) ** 2, factor * np.sin(z) ** 2)
    np.testing.assert_allclose(number * factor, trials)
    np.testing.assert_allclose(gray_scale(constant, z, trials), 0.05 / np.sqrt(factor))
    # A bright scene stays as it is.
    np.testing.assert_allclose(gray_scale(constant, z + 0.5, trials), 0.05)


def test_the_gain_is_the_ratio_of_two_binomial_probabilities():
    rng = np.random.default_rng(3)
    ones = rng.binomial(12, 0.3, (5, 6)).astype(np.int32)
    first, second = divide_bits(ones, np.full((5, 6), 12.0))
    p = rng.uniform(0.1, 0.6, (5, 6))
    errors = HalfErrors.measure(np.arcsin(np.sqrt(p)), first, second)
    fraction = (first.ones + 0.5) / (first.trials + 1)
    expected = binom.logpmf(second.ones, 6, p) - binom.logpmf(second.ones, 6, fraction)
    np.testing.assert_allclose(errors.gain, expected, atol=1e-9)
