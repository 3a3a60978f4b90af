"""The proximal map of the likelihood."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mpmath import mp

import jotlight as jl
from jotlight import _engine as engine

RANDOM = np.random.default_rng(0)
TRIALS = 9
MAX_LIGHT = 4.0
PENALTIES = [1e-3, 1.0, 30.0, 1e6]
POINTS = [-1e4, -50.0, -0.1, 0.0, 1e-9, 0.3, 3.9, 4.0, 4.1, 700.0, 1e5]
ONES, DARK, POINT = map(np.array, zip(*product(range(TRIALS + 1), [0.0, 0.2], POINTS), strict=True))
ULP = np.finfo(float).eps * MAX_LIGHT


def proximal(threshold, penalty):
    cells = jl.Likelihood(ONES, TRIALS, threshold=threshold, dark_counts=DARK)
    return cells.proximal(POINT, penalty, max_light=MAX_LIGHT)


def proximal_from(guess, cells, point, penalty):
    """Return the proximal map of cells, with a search that starts at the guess, as in ADMM."""
    start, found = (np.broadcast_to(array, cells.shape).copy() for array in (guess, point))
    engine.likelihood_proximal(cells.engine_argument(), penalty, MAX_LIGHT, start, found, None)
    return found


def silence_probability(threshold, rate):
    return mp.exp(-rate) * sum(rate**k / mp.factorial(k) for k in range(threshold))


def derivative(x, threshold, penalty, ones, dark, point):
    """Return the derivative of -ℓ(x) + ½ penalty (x - point)²."""
    rate = x + mp.mpf(dark)
    slope = rate ** (threshold - 1) * mp.exp(-rate) / mp.factorial(threshold - 1)
    silent = silence_probability(threshold, rate)
    score = ones * slope / (1 - silent) - (TRIALS - ones) * slope / silent
    return penalty * (x - mp.mpf(point)) - score


def cost(x, threshold, penalty, ones, dark, point):
    silent = silence_probability(threshold, x + mp.mpf(dark))
    log_likelihood = ones * mp.log(1 - silent) + (TRIALS - ones) * mp.log(silent)
    return penalty * (x - mp.mpf(point)) ** 2 / 2 - log_likelihood


def minimizer(function, low, high):
    """Return the minimizer by golden-section search, which uses only values."""
    low, high, share = mp.mpf(low), mp.mpf(high), (mp.sqrt(5) - 1) / 2
    inner = [high - share * (high - low), low + share * (high - low)]
    values = [function(x) for x in inner]
    for _ in range(60):
        if values[0] < values[1]:
            high = inner[1]
            inner = [high - share * (high - low), inner[0]]
            values = [function(inner[0]), values[0]]
        else:
            low = inner[0]
            inner = [inner[1], low + share * (high - low)]
            values = [values[1], function(inner[1])]
    return float(low + high) / 2


@pytest.mark.parametrize("penalty", PENALTIES)
@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_the_derivative_changes_its_sign_at_the_proximal_map(threshold, penalty):
    found = proximal(threshold, penalty)
    assert found.min() >= 0
    assert found.max() <= MAX_LIGHT
    with mp.workdps(80):
        for x, *case in zip(found, ONES.tolist(), DARK, POINT, strict=True):
            below, above = x * (1 - 1e-9) - ULP, x * (1 + 1e-9) + ULP
            if below > 0:
                assert derivative(mp.mpf(below), threshold, penalty, *case) < 0, (x, case)
            if above < MAX_LIGHT:
                assert derivative(mp.mpf(above), threshold, penalty, *case) > 0, (x, case)


@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.slow
def test_the_proximal_map_minimizes_the_cost(threshold):
    for penalty in PENALTIES:
        found = proximal(threshold, penalty)
        for i in RANDOM.choice(len(found), 8, replace=False):
            case = threshold, penalty, int(ONES[i]), DARK[i], POINT[i]
            with mp.workdps(80):
                expected = minimizer(lambda x, case=case: cost(x, *case), 0, MAX_LIGHT)
            assert found[i] == pytest.approx(expected, rel=1e-9, abs=1e-11), case


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_the_result_does_not_depend_on_the_guess(threshold):
    cells = jl.Likelihood(ONES, TRIALS, threshold=threshold, dark_counts=DARK)
    for penalty in PENALTIES:
        expected = proximal(threshold, penalty)
        for guess in (0.0, 1e-30, 1e-12, 0.05, 1.0, MAX_LIGHT, 1e9, np.inf):
            found = proximal_from(guess, cells, POINT, penalty)
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=ULP, err_msg=str(guess))


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_the_result_is_a_good_guess(threshold):
    found = proximal(threshold, 2.0)
    cells = jl.Likelihood(ONES, TRIALS, threshold=threshold, dark_counts=DARK)
    again = proximal_from(found, cells, POINT, 2.0)
    np.testing.assert_allclose(again, found, rtol=1e-9, atol=ULP)


@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize(("point", "guess"), [(0.5, 1e-100), (1e-100, 1e-100)])
def test_tiny_points_and_guesses_do_not_change_the_result(threshold, point, guess):
    cell = jl.Likelihood([4], TRIALS, threshold=threshold)
    expected = proximal_from(1.0, cell, point, 1.0)
    assert proximal_from(guess, cell, point, 1.0) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("max_light", [1e4, 1e16, 1e30])
def test_a_distant_bound_does_not_change_the_result(threshold, max_light):
    cell = jl.Likelihood([4], TRIALS, threshold=threshold)
    expected = cell.proximal(-5.0, 1.0, max_light=100.0)
    assert cell.proximal(-5.0, 1.0, max_light=max_light) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_the_result_of_a_cell_without_bits_is_its_point(threshold):
    points = np.array([-1e9, -1.0, 0.0, 1e-7, 0.3, 1.0, 4.0, 5.0, 1e9])
    dead = jl.Likelihood(np.zeros(9, int), 0, threshold=threshold)
    for guess in (points, 0.0, 2.0, 3.0):
        found = proximal_from(guess, dead, points, 0.7)
        np.testing.assert_allclose(found, points.clip(0, MAX_LIGHT), rtol=1e-12, atol=ULP)


@pytest.mark.parametrize("threshold", [1, 3])
def test_a_huge_penalty_yields_the_point_and_a_tiny_one_the_maximum_likelihood(threshold):
    cells = jl.Likelihood(np.arange(TRIALS + 1), TRIALS, threshold=threshold)
    points = RANDOM.uniform(0.1, 3.9, TRIALS + 1)
    np.testing.assert_allclose(
        cells.proximal(points, 1e15, max_light=MAX_LIGHT), points, rtol=1e-12
    )
    counts = np.arange(TRIALS + 1)[None]
    likely = jl.mle(counts, jl.Sensor(frames=TRIALS, threshold=threshold, gain=TRIALS,
                                      max_intensity=MAX_LIGHT))  # fmt: skip
    np.testing.assert_allclose(
        cells.proximal(points, 1e-13, max_light=MAX_LIGHT), likely[0], rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("threshold", [1, 2])
@pytest.mark.parametrize("point", [-np.inf, np.inf])
def test_a_point_at_infinity_yields_a_bound(threshold, point):
    found = jl.Likelihood([0, 1, 3], 3, threshold=threshold).proximal(
        point, 1.0, max_light=MAX_LIGHT
    )
    np.testing.assert_array_equal(found, MAX_LIGHT if point > 0 else 0)


@given(
    st.integers(1, 12),
    st.integers(0, 20),
    st.integers(0, 20),
    st.floats(0, 2),
    st.floats(1e-3, 1e6),
    hnp.arrays(float, 2, elements=st.floats(-20, 20).map(lambda x: round(x, 6))),
)
def test_the_proximal_map_is_nonexpansive_and_monotone(
    threshold, ones, zeros, dark, penalty, points
):
    cell = jl.Likelihood([ones, ones], ones + zeros, threshold=threshold, dark_counts=dark)
    low, high = cell.proximal(np.sort(points), penalty, max_light=MAX_LIGHT)
    assert -1e-8 <= high - low <= np.ptp(points) + 1e-8


@pytest.mark.parametrize("threshold", [1, 3])
@pytest.mark.parametrize("size", [1, 15, 17, 4097])
def test_cells_are_independent(threshold, size):
    trials = RANDOM.integers(0, 9, size)
    ones = RANDOM.integers(0, trials + 1)
    dark = RANDOM.choice([0, 0.1], size)
    points = RANDOM.normal(1, 2, size)
    cells = jl.Likelihood(ones, trials, threshold=threshold, dark_counts=dark)
    together = cells.proximal(points, 2.0, max_light=MAX_LIGHT)
    for i in [*range(0, size, 500), size - 1]:
        cell = jl.Likelihood([ones[i]], trials[i], threshold=threshold, dark_counts=dark[i])
        assert cell.proximal([points[i]], 2.0, max_light=MAX_LIGHT) == together[i]


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_result_does_not_depend_on_the_shape_and_layout(threshold):
    ones, points = RANDOM.integers(0, 5, (4, 6)), RANDOM.normal(0, 2, (4, 6))
    flat = jl.Likelihood(ones.ravel(), 4, threshold=threshold)
    expected = flat.proximal(points.ravel(), 1.0, max_light=MAX_LIGHT).reshape(4, 6)
    before = points.copy()
    for change in (np.asarray, np.asfortranarray, np.ndarray.tolist):
        cells = jl.Likelihood(change(ones), 4, threshold=threshold)
        np.testing.assert_array_equal(
            cells.proximal(change(points), 1.0, max_light=MAX_LIGHT), expected
        )
    np.testing.assert_array_equal(points, before)
    same = jl.Likelihood(ones, 4, threshold=threshold)
    np.testing.assert_array_equal(
        same.proximal(0.7, 1.0, max_light=MAX_LIGHT),
        same.proximal(np.full((4, 6), 0.7), 1.0, max_light=MAX_LIGHT),
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"penalty": 0.0},
            "penalty and max_light: expected finite numbers above 0, got 0.0 and 1.0",
        ),
        ({"penalty": -1.0}, "penalty and max_light: .*got -1.0 and 1.0"),
        ({"penalty": np.nan}, "penalty and max_light: .*got nan and 1.0"),
        ({"penalty": np.inf}, "penalty and max_light: .*got inf and 1.0"),
        ({"max_light": 0.0}, "penalty and max_light: .*got 1.0 and 0.0"),
        ({"max_light": np.inf}, "penalty and max_light: .*got 1.0 and inf"),
        ({"max_light": np.nan}, "penalty and max_light: .*got 1.0 and nan"),
        ({"point": [0.5, np.nan]}, "point: expected numbers, got NaN"),
        (
            {"point": [0.5, 0.5, 0.5]},
            r"point: .* array of shape \(2,\), got \(3,\)",
        ),
    ],
    ids=str,
)
def test_arguments_out_of_range_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        jl.Likelihood([0, 1]).proximal(
            **{"point": [0.5, 0.5], "penalty": 1.0, "max_light": 1.0} | arguments
        )
