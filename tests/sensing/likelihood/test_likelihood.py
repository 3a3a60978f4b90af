"""The likelihood of bits against exact arithmetic and finite differences."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp
from scipy.special import gammainc

import jotlight as jl
from one_cell import evaluate

RANDOM = np.random.default_rng(0)
THRESHOLDS = [1, 2, 3, 5, 20, 100]
NEAR_THRESHOLDS = np.array(THRESHOLDS)[:, None] * [0.9, 0.99, 0.999, 1.0, 1.001, 1.01, 1.2]
LIGHTS = np.concatenate([np.geomspace(1e-12, 1e4, 33), NEAR_THRESHOLDS.ravel()])
DIGITS = 1e-12
UNDERFLOW = 1e-290


class Exact:
    """Logarithms, derivatives, and information of one bit: P' = s^(q - 1) exp(-s) / (q - 1)!."""

    def __init__(self, threshold, rate):
        rate = mp.mpf(rate)
        p_one = mp.gammainc(threshold, 0, rate, regularized=True)
        p_zero = mp.gammainc(threshold, rate, mp.inf, regularized=True)
        slope = rate ** (threshold - 1) * mp.exp(-rate) / mp.factorial(threshold - 1)
        second = slope * ((threshold - 1) / rate - 1)
        self.log_one = mp.log(p_one) if p_zero > 0.5 else mp.log1p(-p_zero)
        self.log_zero = mp.log(p_zero) if p_one > 0.5 else mp.log1p(-p_one)
        self.one = slope / p_one, (slope / p_one) ** 2 - second / p_one
        self.zero = -slope / p_zero, (slope / p_zero) ** 2 + second / p_zero
        self.information = slope**2 / p_one / p_zero


def close(found, exact, digits=DIGITS):
    return abs(found - exact) <= digits * abs(exact) + UNDERFLOW


@pytest.fixture(autouse=True)
def fifty_digits():
    with mp.workdps(50):
        yield


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_the_likelihood_of_a_one_is_right_to_twelve_digits(threshold):
    for light in LIGHTS:
        exact = Exact(threshold, light)
        found = evaluate(1, 1, light, threshold=threshold)
        expected = exact.log_one, *exact.one, exact.information
        assert all(map(close, found, expected)), (light, found, expected)


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_the_likelihood_of_a_zero_is_right_to_twelve_digits(threshold):
    for light in LIGHTS:
        exact = Exact(threshold, light)
        value, gradient, curvature, information = evaluate(0, 1, light, threshold=threshold)
        assert close(value, exact.log_zero), light
        assert close(gradient, exact.zero[0]), light
        assert close(information, exact.information), light
        if threshold == 1:
            assert curvature == 0
        else:
            assert close(curvature, exact.zero[1]), light


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_bits_add_up_and_include_the_dark_counts(threshold):
    light, dark = np.geomspace(1e-9, 300, 40), RANDOM.permutation(np.geomspace(1e-7, 50, 40))
    trials = RANDOM.integers(0, 50, 40)
    ones = RANDOM.integers(0, trials + 1)
    cells = jl.Likelihood(ones, trials, threshold=threshold, dark_counts=dark)
    gradient, curvature = cells.gradient_and_curvature(light)
    information = cells.information(light)
    total = size = mp.mpf(0)
    for i in range(40):
        zeros = int(trials[i] - ones[i])
        exact = Exact(threshold, mp.mpf(light[i]) + mp.mpf(dark[i]))
        terms = ones[i] * exact.one[0], zeros * exact.zero[0]
        assert abs(gradient[i] - sum(terms)) <= DIGITS * (terms[0] - terms[1]) + UNDERFLOW
        assert close(curvature[i], ones[i] * exact.one[1] + zeros * exact.zero[1])
        assert close(information[i], int(trials[i]) * exact.information)
        value = ones[i] * exact.log_one + zeros * exact.log_zero
        assert close(jl.Likelihood([ones[i]], int(trials[i]), threshold=threshold,
                                   dark_counts=dark[i]).value([light[i]]), value)  # fmt: skip
        total, size = total + value, size + abs(value)
    assert abs(cells.value(light) - total) <= DIGITS * size


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_gradient_and_curvature_agree_with_finite_differences(threshold):
    light = np.geomspace(0.05, 3, 25) * threshold
    ones = RANDOM.integers(0, 11, 25)

    def values(light):
        return np.array(
            [
                jl.Likelihood([one], 10, threshold=threshold).value([s])
                for one, s in zip(ones, light, strict=True)
            ]
        )

    cells = jl.Likelihood(ones, 10, threshold=threshold)
    gradient, curvature = cells.gradient_and_curvature(light)
    step = 1e-5 * light
    np.testing.assert_allclose(
        gradient * light,
        (values(light + step) - values(light - step)) / 2e-5,
        rtol=1e-6,
        atol=1e-6 * threshold,
    )
    np.testing.assert_allclose(
        curvature * light,
        (
            cells.gradient_and_curvature(light - step)[0]
            - cells.gradient_and_curvature(light + step)[0]
        )
        / 2e-5,
        rtol=1e-6,
        atol=1e-6,
    )


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_information_is_the_expectation_of_the_curvature(threshold):
    light, trials = 0.6 * threshold, 12
    p = float(gammainc(threshold, light))
    counts = np.arange(trials + 1)
    probabilities = [math.comb(trials, k) * p**k * (1 - p) ** (trials - k) for k in counts]
    cells = jl.Likelihood(counts, trials, threshold=threshold)
    gradient, curvature = cells.gradient_and_curvature(light)
    information = cells.information(light)
    np.testing.assert_allclose(information, probabilities @ curvature, rtol=1e-12)
    np.testing.assert_allclose(information, probabilities @ gradient**2, rtol=1e-12)
    assert probabilities @ gradient == pytest.approx(0, abs=1e-12 * trials)


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_the_likelihood_of_an_impossible_bit_is_0(threshold):
    assert jl.Likelihood([1, 0], 2, threshold=threshold).value(0.0) == -np.inf
    assert jl.Likelihood([0, 0], 2, threshold=threshold).value(0.0) == 0
    with_dark = jl.Likelihood([1, 0], 2, threshold=threshold, dark_counts=0.5)
    expected = Exact(threshold, 0.5).log_one + 3 * Exact(threshold, 0.5).log_zero
    assert close(with_dark.value(0.0), expected)


@pytest.mark.parametrize("threshold", THRESHOLDS)
@pytest.mark.parametrize("light", [0.0, 5e-324, 1e-200, 1e-12])
def test_derivatives_are_finite_and_grow_towards_darkness(threshold, light):
    gradient, curvature = jl.Likelihood([0, 1, 9], 9, threshold=threshold).gradient_and_curvature(
        light
    )
    assert np.isfinite([gradient, curvature]).all()
    assert gradient[0] <= 0 < 1e11 < gradient[1] < gradient[2]
    assert 0 <= curvature[0] < 1e22 < curvature[1] < curvature[2]


def test_information_in_darkness_is_the_limit():
    information = [jl.Likelihood([0], 7, threshold=q).information(0.0)[0] for q in (1, 2, 3, 20)]
    assert information[0] > 1e100
    assert information[1] == pytest.approx(14, rel=1e-12)
    assert information[2:] == pytest.approx([0, 0], abs=1e-100)


@pytest.mark.parametrize("threshold", THRESHOLDS)
@pytest.mark.parametrize("light", [0.0, 0.3, 1e4])
def test_a_dead_cell_contributes_nothing(threshold, light):
    dead = jl.Likelihood([0, 3], [0, 7], threshold=threshold, dark_counts=[0.2, 0.1])
    alive = jl.Likelihood([3], 7, threshold=threshold, dark_counts=0.1)
    assert dead.value(light) == alive.value(light)
    (none, gradient), (flat, curvature) = dead.gradient_and_curvature(light)
    assert none == flat == dead.information(light)[0] == 0
    assert [[gradient], [curvature]] == [list(x) for x in alive.gradient_and_curvature(light)]


@given(
    st.integers(1, 300),
    st.floats(0, 1e5),
    st.floats(0, 1e3),
    st.integers(0, 10**6),
    st.integers(0, 10**6),
)
def test_log_likelihood_is_concave(threshold, light, dark, ones, zeros):
    cell = jl.Likelihood([ones], ones + zeros, threshold=threshold, dark_counts=dark)
    gradient, curvature = cell.gradient_and_curvature(light)
    assert curvature >= 0
    assert np.isfinite([gradient, curvature, cell.information(light)]).all()
    assert cell.gradient_and_curvature(light * 1.5)[0] <= gradient + 1e-11 * (1 + abs(gradient)) * (
        ones + zeros
    )
    assert cell.value(light) <= 0


@given(st.integers(1, 40), st.floats(1e-3, 100), st.floats(1e-3, 100), st.integers(0, 9))
def test_the_value_lies_below_every_tangent(threshold, here, there, ones):
    cell = jl.Likelihood([ones], 9, threshold=threshold)
    value, (slope,) = cell.value(here), cell.gradient_and_curvature(here)[0]
    rounding = 1e-11 * (abs(value) + abs(slope * (there - here)) + 1)
    assert cell.value(there) <= value + slope * (there - here) + rounding


def test_the_largest_count_is_accepted():
    maximum = 2**31 - 1
    cells = jl.Likelihood([0, maximum, 1], maximum)
    exact = Exact(1, 0.5)
    expected = (maximum + 1) * exact.log_one + (2 * maximum - 1) * exact.log_zero
    assert close(cells.value(0.5), expected)


@pytest.mark.parametrize("threshold", [1, 3])
def test_at_an_infinite_light_a_zero_is_impossible(threshold):
    assert jl.Likelihood([2], trials=2, threshold=threshold).value([np.inf]) == 0
    assert jl.Likelihood([1], trials=2, threshold=threshold).value([np.inf]) == -np.inf
