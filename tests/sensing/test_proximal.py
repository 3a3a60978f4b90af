from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mpmath import mp
from scipy.optimize import minimize

import jotlight as jl
from jotlight.estimators.tv import NORMS, shrink, total_variation

RANDOM = np.random.default_rng(0)
TRIALS = 9
MOST = 4.0
PENALTIES = [1e-3, 1.0, 30.0, 1e6]
POINTS = [-1e4, -50.0, -0.1, 0.0, 1e-9, 0.3, 3.9, 4.0, 4.1, 700.0, 1e5]
ONES, DARK, POINT = map(np.array, zip(*product(range(TRIALS + 1), [0.0, 0.2], POINTS), strict=True))
ULP = np.finfo(float).eps * MOST


def proximal(threshold, penalty, **options):
    cells = jl.Likelihood(ONES, TRIALS, threshold=threshold, dark_counts=DARK)
    return cells.proximal(POINT, penalty, max_light=MOST, **options)


def stays_dark(threshold, rate):
    return mp.exp(-rate) * sum(rate**k / mp.factorial(k) for k in range(threshold))


def rise(x, threshold, penalty, ones, dark, point):
    """The slope of -ℓ(x) + ½ penalty (x - point)²."""
    rate = x + mp.mpf(dark)
    slope = rate ** (threshold - 1) * mp.exp(-rate) / mp.factorial(threshold - 1)
    silent = stays_dark(threshold, rate)
    score = ones * slope / (1 - silent) - (TRIALS - ones) * slope / silent
    return penalty * (x - mp.mpf(point)) - score


def cost(x, threshold, penalty, ones, dark, point):
    silent = stays_dark(threshold, x + mp.mpf(dark))
    log_likelihood = ones * mp.log(1 - silent) + (TRIALS - ones) * mp.log(silent)
    return penalty * (x - mp.mpf(point)) ** 2 / 2 - log_likelihood


def least(function, low, high):
    """By the golden section, where only values are looked at."""
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
def test_the_slope_changes_its_sign_at_the_proximal_map(threshold, penalty):
    found = proximal(threshold, penalty)
    assert found.min() >= 0
    assert found.max() <= MOST
    with mp.workdps(80):
        for x, *case in zip(found, ONES.tolist(), DARK, POINT, strict=True):
            below, above = x * (1 - 1e-9) - ULP, x * (1 + 1e-9) + ULP
            if below > 0:
                assert rise(mp.mpf(below), threshold, penalty, *case) < 0, (x, case)
            if above < MOST:
                assert rise(mp.mpf(above), threshold, penalty, *case) > 0, (x, case)


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_the_proximal_map_has_the_least_cost_of_all(threshold):
    for penalty in PENALTIES:
        found = proximal(threshold, penalty)
        for i in RANDOM.choice(len(found), 15, replace=False):
            case = threshold, penalty, int(ONES[i]), DARK[i], POINT[i]
            with mp.workdps(80):
                expected = least(lambda x, case=case: cost(x, *case), 0, MOST)
            assert found[i] == pytest.approx(expected, rel=1e-9, abs=1e-11), case


@pytest.mark.parametrize("penalty", PENALTIES)
@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("guess", [0.0, 1e-30, 1e-12, 0.05, 1.0, MOST, 1e9, np.inf])
def test_the_guess_changes_nothing(threshold, penalty, guess):
    np.testing.assert_allclose(
        proximal(threshold, penalty, guess=guess), proximal(threshold, penalty), rtol=1e-9, atol=ULP
    )


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_the_result_is_as_good_a_guess_as_any(threshold):
    found = proximal(threshold, 2.0)
    again = proximal(threshold, 2.0, guess=found)
    np.testing.assert_allclose(again, found, rtol=1e-9, atol=ULP)


@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize(("point", "guess"), [(0.5, 1e-100), (1e-100, None)])
def test_a_guess_next_to_nothing_changes_nothing(threshold, point, guess):
    cell = jl.Likelihood([4], TRIALS, threshold=threshold)
    expected = cell.proximal(point, 1.0, max_light=MOST, guess=1.0)
    assert cell.proximal(point, 1.0, max_light=MOST, guess=guess) == pytest.approx(
        expected, rel=1e-8
    )


@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("most", [1e4, 1e16, 1e30])
def test_a_bound_far_away_changes_nothing(threshold, most):
    cell = jl.Likelihood([4], TRIALS, threshold=threshold)
    expected = cell.proximal(-5.0, 1.0, max_light=100.0)
    assert cell.proximal(-5.0, 1.0, max_light=most) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_a_cell_without_bits_goes_to_its_point(threshold):
    points = np.array([-1e9, -1.0, 0.0, 1e-7, 0.3, 1.0, 4.0, 5.0, 1e9])
    dead = jl.Likelihood(np.zeros(9, int), 0, threshold=threshold)
    for guess in (None, 0.0, 2.0, 3.0):
        found = dead.proximal(points, 0.7, max_light=MOST, guess=guess)
        np.testing.assert_allclose(found, points.clip(0, MOST), rtol=1e-12, atol=ULP)


@pytest.mark.parametrize("threshold", [1, 3])
def test_a_huge_penalty_leaves_the_point_and_a_tiny_one_the_most_likely_light(threshold):
    cells = jl.Likelihood(np.arange(TRIALS + 1), TRIALS, threshold=threshold)
    points = RANDOM.uniform(0.1, 3.9, TRIALS + 1)
    np.testing.assert_allclose(cells.proximal(points, 1e15, max_light=MOST), points, rtol=1e-12)
    counts = np.arange(TRIALS + 1)[None]
    likely = jl.mle(counts, jl.Sensor(frames=TRIALS, threshold=threshold, gain=TRIALS,
                                      max_intensity=MOST))  # fmt: skip
    np.testing.assert_allclose(
        cells.proximal(points, 1e-13, max_light=MOST), likely[0], rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("threshold", [1, 2])
@pytest.mark.parametrize("point", [-np.inf, np.inf])
def test_a_point_at_infinity_goes_to_the_end(threshold, point):
    found = jl.Likelihood([0, 1, 3], 3, threshold=threshold).proximal(point, 1.0, max_light=MOST)
    np.testing.assert_array_equal(found, MOST if point > 0 else 0)


@given(
    st.integers(1, 12),
    st.integers(0, 20),
    st.integers(0, 20),
    st.floats(0, 2),
    st.floats(1e-3, 1e6),
    hnp.arrays(float, 2, elements=st.floats(-20, 20).map(lambda x: round(x, 6))),
)
def test_two_points_come_no_further_apart_and_keep_their_order(
    threshold, ones, zeros, dark, penalty, points
):
    cell = jl.Likelihood([ones, ones], ones + zeros, threshold=threshold, dark_counts=dark)
    low, high = cell.proximal(np.sort(points), penalty, max_light=MOST)
    assert -1e-8 <= high - low <= np.ptp(points) + 1e-8


@pytest.mark.parametrize("threshold", [1, 3])
@pytest.mark.parametrize("size", [1, 15, 17, 4097])
def test_cells_do_not_know_of_each_other(threshold, size):
    trials = RANDOM.integers(0, 9, size)
    ones = RANDOM.integers(0, trials + 1)
    dark = RANDOM.choice([0, 0.1], size)
    points = RANDOM.normal(1, 2, size)
    cells = jl.Likelihood(ones, trials, threshold=threshold, dark_counts=dark)
    together = cells.proximal(points, 2.0, max_light=MOST)
    for i in [*range(0, size, 500), size - 1]:
        cell = jl.Likelihood([ones[i]], trials[i], threshold=threshold, dark_counts=dark[i])
        assert cell.proximal([points[i]], 2.0, max_light=MOST) == together[i]


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_shape_of_the_cells_changes_nothing(threshold):
    ones, points = RANDOM.integers(0, 5, (4, 6)), RANDOM.normal(0, 2, (4, 6))
    flat = jl.Likelihood(ones.ravel(), 4, threshold=threshold)
    expected = flat.proximal(points.ravel(), 1.0, max_light=MOST).reshape(4, 6)
    before = points.copy()
    for change in (np.asarray, np.asfortranarray, np.ndarray.tolist):
        cells = jl.Likelihood(change(ones), 4, threshold=threshold)
        np.testing.assert_array_equal(cells.proximal(change(points), 1.0, max_light=MOST), expected)
    np.testing.assert_array_equal(points, before)
    same = jl.Likelihood(ones, 4, threshold=threshold)
    np.testing.assert_array_equal(
        same.proximal(0.7, 1.0, max_light=MOST),
        same.proximal(np.full((4, 6), 0.7), 1.0, max_light=MOST),
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
        ({"point": [0.5, 0.5, 0.5]}, r"point: expected shape \(2,\), got \(3,\)"),
        ({"guess": [0.5, -0.5]}, "expected 0 or more, got -0.5"),
        ({"guess": [0.5, np.nan]}, "expected 0 or more, got nan"),
        ({"guess": [0.5, 0.5, 0.5]}, r"expected shape \(2,\), got \(3,\)"),
    ],
    ids=str,
)
def test_a_proximal_map_that_cannot_be_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        jl.Likelihood([0, 1]).proximal(
            **{"point": [0.5, 0.5], "penalty": 1.0, "max_light": 1.0} | arguments
        )


def length(vector, norm):
    return np.hypot(*vector) if norm == "isotropic" else np.abs(vector).sum()


@pytest.mark.parametrize("norm", NORMS)
def test_shrinking_has_the_least_cost_of_all(norm):
    planes = RANDOM.normal(0, 2, (2, 4, 5))
    thresholds = RANDOM.uniform(0, 3, (4, 5))
    found = shrink(planes, thresholds, norm)
    for place in np.ndindex(4, 5):
        goal, threshold = planes[:, *place], thresholds[place]

        def cost(v, goal=goal, threshold=threshold):
            return threshold * length(v, norm) + np.sum((v - goal) ** 2) / 2

        nearby = (
            found[:, *place] + RANDOM.normal(0, 1, (200, 2)) * np.geomspace(1e-6, 3, 200)[:, None]
        )
        best = minimize(cost, goal, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-15})
        at_found = cost(found[:, *place])
        assert at_found <= min(map(cost, nearby)) + 1e-14
        assert at_found <= best.fun + 1e-14
        np.testing.assert_allclose(found[:, *place], best.x, atol=1e-6)


@pytest.mark.parametrize("norm", NORMS)
def test_shrinking_a_signal_is_soft_thresholding(norm):
    signal = RANDOM.normal(0, 1, (1, 50))
    expected = np.sign(signal) * np.maximum(np.abs(signal) - 0.4, 0)
    np.testing.assert_allclose(shrink(signal, 0.4, norm), expected, rtol=1e-14, atol=1e-15)
    thresholds = RANDOM.uniform(0, 1, 50)
    each = [shrink(signal[:, [i]], thresholds[i], norm)[0, 0] for i in range(50)]
    np.testing.assert_array_equal(shrink(signal, thresholds, norm), [each])


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("shape", [(1, 7), (2, 5, 3), (2, 1, 1)])
def test_a_threshold_of_0_changes_nothing_and_a_large_one_leaves_nothing(norm, shape):
    planes = RANDOM.normal(0, 1, shape)
    before = planes.copy()
    np.testing.assert_array_equal(shrink(planes, 0.0, norm), planes)
    np.testing.assert_array_equal(shrink(planes, np.zeros(shape[1:]), norm), planes)
    np.testing.assert_array_equal(shrink(planes, 1e3, norm), 0)
    np.testing.assert_array_equal(shrink(np.zeros(shape), 0.0, norm), 0)
    np.testing.assert_array_equal(planes, before)


@pytest.mark.parametrize("norm", NORMS)
def test_a_number_is_a_map_that_is_the_same_everywhere(norm):
    planes = RANDOM.normal(0, 1, (2, 40, 30))
    everywhere = np.full((40, 30), 0.6)
    expected = shrink(planes, 0.6, norm)
    np.testing.assert_array_equal(shrink(planes, everywhere, norm), expected)
    np.testing.assert_array_equal(shrink(np.asfortranarray(planes), 0.6, norm), expected)
    np.testing.assert_array_equal(shrink(planes.tolist(), everywhere.tolist(), norm), expected)


@given(
    hnp.arrays(float, (2, 2, 1, 1), elements=st.floats(-9, 9)),
    st.floats(0, 9),
    st.sampled_from(NORMS),
)
def test_shrinking_brings_two_points_no_further_apart(pair, threshold, norm):
    shrunk = [shrink(planes, threshold, norm) for planes in pair]
    apart = np.linalg.norm(np.ravel(pair[0] - pair[1]))
    assert np.linalg.norm(np.ravel(shrunk[0] - shrunk[1])) <= apart + 1e-12


def slow_variation(image, weights, norm):
    height, width = image.shape
    total = 0.0
    for row, column in np.ndindex(image.shape):
        down = image[row + 1, column] - image[row, column] if row + 1 < height else 0.0
        right = image[row, column + 1] - image[row, column] if column + 1 < width else 0.0
        total += weights[row, column] * length(np.array([down, right]), norm)
    return total


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (5, 1), (23, 31)])
def test_total_variation_is_the_sum_of_all_lengths(norm, shape):
    image, weights = RANDOM.normal(0, 1, (2, *shape))
    weights = np.abs(weights)
    expected = slow_variation(image, weights, norm)
    assert total_variation(image, norm, weight=weights) == pytest.approx(expected, rel=1e-13)
    plain = slow_variation(image, np.ones(shape), norm)
    assert total_variation(image, norm) == pytest.approx(plain, rel=1e-13)
    assert total_variation(image, norm, weight=2.5) == pytest.approx(2.5 * plain, rel=1e-13)
    assert total_variation(image, norm, weight=0) == 0


@pytest.mark.parametrize("norm", NORMS)
def test_total_variation_of_a_signal_is_that_of_an_image_of_one_row(norm):
    signal, weights = RANDOM.random((2, 200))
    expected = np.sum(weights[:-1] * np.abs(np.diff(signal)))
    assert total_variation(signal, norm, weight=weights) == pytest.approx(expected, rel=1e-13)
    assert total_variation(signal[None], norm, weight=weights[None]) == total_variation(
        signal, norm, weight=weights
    )


def test_total_variation_is_isotropic_by_default_and_takes_any_numbers():
    image = RANDOM.integers(0, 255, (6, 7), np.uint8)
    expected = slow_variation(image.astype(float), np.ones((6, 7)), "isotropic")
    for given_image in (image, image.tolist(), np.asfortranarray(image)):
        assert total_variation(given_image) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (total_variation, (1.0,), r"image: expected shape \(H, W\) or \(N,\).*got \(\)"),
        (total_variation, ([],), r"image: .*got \(0,\)"),
        (total_variation, (np.ones((2, 0)),), r"image: .*got \(2, 0\)"),
        (total_variation, (np.ones((2, 2, 3)),), r"image: .*got \(2, 2, 3\)"),
        (total_variation, ([1.0], "l1"), "norm: expected one of isotropic, anisotropic, got 'l1'"),
        (shrink, ([1.0], 1.0), r"planes: expected shape \(2, H, W\) or \(1, N\), got \(1,\)"),
        (shrink, (np.ones((2, 5)), 1.0), r"planes: .*got \(2, 5\)"),
        (shrink, (np.ones((1, 2, 3)), 1.0), r"planes: .*got \(1, 2, 3\)"),
        (shrink, (np.ones((3, 2, 2)), 1.0), r"planes: .*got \(3, 2, 2\)"),
        (shrink, (np.ones((2, 0, 3)), 1.0), r"planes: .*got \(2, 0, 3\)"),
        (shrink, ([[1.0]], 1.0, "euclidean"), "norm: .*got 'euclidean'"),
    ],
)
def test_arrays_and_norms_that_cannot_be_are_refused(function, arguments, message):
    with pytest.raises(ValueError, match=message):
        function(*arguments)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (-0.1, "expected finite numbers, 0 or more, got -0.1"),
        (np.nan, "expected finite numbers, 0 or more, got nan"),
        (np.inf, "expected finite numbers, 0 or more, got inf"),
        ([[1.0, 1.0], [-1.0, 1.0]], "expected finite numbers, 0 or more, got -1.0"),
        ([[1.0, 1.0], [np.nan, 1.0]], "expected finite numbers, 0 or more, got nan"),
        ([1.0, 1.0], r"expected a number, or an array of shape \(2, 2\), got float64 of shape"),
        ("1", r"expected a number, or an array of shape \(2, 2\), got <U1"),
        (True, r"expected a number, or an array of shape \(2, 2\), got bool"),
        (1j, r"expected a number, or an array of shape \(2, 2\), got complex128"),
    ],
    ids=str,
)
def test_weights_and_thresholds_that_cannot_be_are_refused(value, message):
    with pytest.raises(ValueError, match=f"weight: {message}"):
        total_variation(np.ones((2, 2)), weight=value)
    with pytest.raises(ValueError, match=f"threshold: {message}"):
        shrink(np.ones((2, 2, 2)), value)
