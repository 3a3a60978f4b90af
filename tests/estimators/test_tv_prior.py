"""The total variation and the shrinkage of its proximal map."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.optimize import minimize

from jotlight.estimators.tv import NORMS, shrink, total_variation

RANDOM = np.random.default_rng(0)
PRECISE = {"xatol": 1e-9, "fatol": 1e-15}


def length(vector, norm):
    return np.hypot(*vector) if norm == "isotropic" else np.abs(vector).sum()


@pytest.mark.slow
@pytest.mark.parametrize("norm", NORMS)
def test_shrinking_minimizes_its_cost(norm):
    planes = RANDOM.normal(0, 2, (2, 4, 5))
    thresholds = RANDOM.uniform(0, 3, (4, 5))
    found = shrink(planes, thresholds, norm)
    for pixel in np.ndindex(4, 5):
        goal, threshold = planes[:, *pixel], thresholds[pixel]

        def cost(v, goal=goal, threshold=threshold):
            return threshold * length(v, norm) + np.sum((v - goal) ** 2) / 2

        nearby = (
            found[:, *pixel] + RANDOM.normal(0, 1, (200, 2)) * np.geomspace(1e-6, 3, 200)[:, None]
        )
        # A simplex may collapse at a kink of the cost, so several start at different points.
        starts = [share * goal for share in (1.0, 0.75, 0.5, 0.25)]
        bests = [minimize(cost, x, method="Nelder-Mead", options=PRECISE) for x in starts]
        best = min(bests, key=lambda result: result.fun)
        at_found = cost(found[:, *pixel])
        assert at_found <= min(map(cost, nearby)) + 1e-14
        assert at_found <= best.fun + 1e-14
        np.testing.assert_allclose(found[:, *pixel], best.x, atol=1e-6)


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
def test_a_threshold_of_0_changes_nothing_and_a_large_one_yields_0(norm, shape):
    planes = RANDOM.normal(0, 1, shape)
    before = planes.copy()
    np.testing.assert_array_equal(shrink(planes, 0.0, norm), planes)
    np.testing.assert_array_equal(shrink(planes, np.zeros(shape[1:]), norm), planes)
    np.testing.assert_array_equal(shrink(planes, 1e3, norm), 0)
    np.testing.assert_array_equal(shrink(np.zeros(shape), 0.0, norm), 0)
    np.testing.assert_array_equal(planes, before)


@pytest.mark.parametrize("norm", NORMS)
def test_a_number_and_a_constant_map_are_the_same_threshold(norm):
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
def test_shrinking_is_nonexpansive(pair, threshold, norm):
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


def test_total_variation_is_isotropic_by_default_and_accepts_any_numbers():
    image = RANDOM.integers(0, 255, (6, 7), np.uint8)
    expected = slow_variation(image.astype(float), np.ones((6, 7)), "isotropic")
    for same in (image, image.tolist(), np.asfortranarray(image)):
        assert total_variation(same) == pytest.approx(expected, rel=1e-14)


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
def test_other_shapes_and_norms_are_refused(function, arguments, message):
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
        ("1", r"expected a number, or an array of shape \(2, 2\), got '1'"),
        (True, r"expected a number, or an array of shape \(2, 2\), got True"),
        (1j, r"expected a number, or an array of shape \(2, 2\), got 1j"),
    ],
    ids=str,
)
def test_weights_and_thresholds_out_of_range_are_refused(value, message):
    with pytest.raises(ValueError, match=f"weight: {message}"):
        total_variation(np.ones((2, 2)), weight=value)
    with pytest.raises(ValueError, match=f"threshold: {message}"):
        shrink(np.ones((2, 2, 2)), value)
