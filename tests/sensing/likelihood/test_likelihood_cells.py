"""Many cells of a likelihood: their independence, layout, and checks."""

import math

import numpy as np
import pytest
from scipy.special import gammainc, gammaincc, xlogy

import jotlight as jl
from one_cell import evaluate

RANDOM = np.random.default_rng(0)
SIZES = [1, 15, 16, 17, 4095, 4096, 4097, 3 * 4096 + 21]


def make_cells(shape, threshold, **options):
    trials = RANDOM.integers(0, 30, shape)
    ones = RANDOM.integers(0, trials + 1)
    dark = RANDOM.uniform(0, 0.2, shape) * (RANDOM.random(shape) < 0.8)
    light = threshold * RANDOM.gamma(0.5, 2, shape) + 1e-9
    return jl.Likelihood(ones, trials, threshold=threshold, dark_counts=dark, **options), light


@pytest.mark.parametrize("size", SIZES)
def test_cells_of_threshold_1_agree_with_the_formula_for_any_number_of_cells(size):
    cells, light = make_cells(size, 1)
    light[::3] *= 300
    ones, zeros = cells.ones, cells.trials - cells.ones
    rate = light + cells.dark_counts
    score = np.exp(-rate) / -np.expm1(-rate)
    gradient, curvature = cells.gradient_and_curvature(light)
    np.testing.assert_allclose(gradient, ones * score - zeros, rtol=1e-13, atol=1e-14 * 30)
    np.testing.assert_allclose(curvature, ones * score * (1 + score), rtol=1e-13, atol=1e-300)
    np.testing.assert_allclose(
        cells.information(light), cells.trials * score, rtol=1e-13, atol=1e-300
    )
    log_p = np.log(-np.expm1(-rate))
    assert cells.value(light) == pytest.approx(math.fsum(ones * log_p - zeros * rate), rel=1e-13)


@pytest.mark.parametrize("size", SIZES)
def test_cells_of_threshold_3_agree_with_the_formula_for_any_number_of_cells(size):
    cells, light = make_cells(size, 3)
    ones, zeros = cells.ones, cells.trials - cells.ones
    rate = light + cells.dark_counts
    p_one, p_zero = gammainc(3, rate), gammaincc(3, rate)
    slope = rate**2 * np.exp(-rate) / 2
    terms = ones * slope / p_one, zeros * slope / p_zero
    np.testing.assert_allclose(
        cells.gradient_and_curvature(light)[0], terms[0] - terms[1], rtol=1e-11, atol=1e-12 * 30
    )
    np.testing.assert_allclose(
        cells.information(light), cells.trials * slope**2 / p_one / p_zero, rtol=1e-11, atol=1e-290
    )
    value = math.fsum(xlogy(ones, p_one) + xlogy(zeros, p_zero))
    assert cells.value(light) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("threshold", [1, 4])
def test_cells_are_independent(threshold):
    cells, light = make_cells(50, threshold)
    together = np.array([*cells.gradient_and_curvature(light), cells.information(light)])
    for i in range(50):
        alone = evaluate(
            cells.ones[i],
            cells.trials[i],
            light[i],
            threshold=threshold,
            dark_counts=cells.dark_counts[i],
        )
        np.testing.assert_array_equal(together[:, i], alone[1:])


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_result_does_not_depend_on_the_shape(threshold):
    flat, light = make_cells(120, threshold)
    options = {"threshold": threshold}
    for shape in [(8, 15), (2, 3, 20), (1, 120)]:
        cells = jl.Likelihood(
            flat.ones.reshape(shape),
            flat.trials.reshape(shape),
            dark_counts=flat.dark_counts.reshape(shape),
            **options,
        )
        assert cells.shape == shape
        assert cells.value(light.reshape(shape)) == flat.value(light)
        for found, expected in zip(
            [
                *cells.gradient_and_curvature(light.reshape(shape)),
                cells.information(light.reshape(shape)),
            ],
            [*flat.gradient_and_curvature(light), flat.information(light)],
            strict=True,
        ):
            np.testing.assert_array_equal(found, expected.reshape(shape))


@pytest.mark.parametrize("threshold", [1, 3])
def test_a_number_stands_for_all_cells(threshold):
    ones = RANDOM.integers(0, 8, (5, 7))
    numbers = jl.Likelihood(ones, 7, threshold=threshold, dark_counts=0.25)
    maps = jl.Likelihood(
        ones.tolist(),
        np.full((5, 7), 7, np.uint8),
        threshold=threshold,
        dark_counts=np.full((5, 7), 0.25, np.float32),
    )
    everywhere = np.full((5, 7), 0.75)
    assert numbers.value(0.75) == maps.value(everywhere)
    np.testing.assert_array_equal(
        numbers.gradient_and_curvature(0.75), maps.gradient_and_curvature(everywhere)
    )
    np.testing.assert_array_equal(numbers.information(0.75), maps.information(everywhere))


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_result_does_not_depend_on_the_layout_of_the_arrays(threshold):
    cells, light = make_cells((40, 30), threshold)
    same = jl.Likelihood(
        np.asfortranarray(cells.ones),
        cells.trials[::-1][::-1],
        threshold=threshold,
        dark_counts=np.asfortranarray(cells.dark_counts),
    )
    same_light = np.asfortranarray(light)
    assert same.value(same_light) == cells.value(light)
    np.testing.assert_array_equal(
        same.gradient_and_curvature(same_light), cells.gradient_and_curvature(light)
    )
    np.testing.assert_array_equal(same.information(same_light), cells.information(light))


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_result_does_not_depend_on_the_number_of_threads(threshold):
    cells, light = make_cells((131, 97), threshold)
    results = []
    for threads in (1, 2, 7):
        same = jl.Likelihood(
            cells.ones,
            cells.trials,
            threshold=threshold,
            dark_counts=cells.dark_counts,
            threads=threads,
        )
        arrays = [
            np.float64(same.value(light)),
            *same.gradient_and_curvature(light),
            same.information(light),
        ]
        arrays.append(same.proximal(light, 3.0, max_light=9.0))
        results.append(b"".join(array.tobytes() for array in arrays))
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize(
    ("ones", "options", "error", "message"),
    [
        ([1.0], {}, TypeError, "ones: expected whole numbers, got float64"),
        (["1"], {}, TypeError, "ones: expected whole numbers"),
        (np.ma.array([1]), {}, TypeError, "ones: expected a plain array, got a masked one"),
        ([-1], {}, ValueError, r"ones: expected 0 to 2\*\*31 - 1, got -1 to -1"),
        ([2**31], {"trials": 3}, ValueError, r"ones: expected 0 to 2\*\*31 - 1, got 2147483648"),
        ([0, 3], {"trials": 2}, ValueError, "ones: expected 0 to the number of trials"),
        ([2], {}, ValueError, "ones: .* got 2 of 1 at the index"),
        ([1, 1], {"trials": [2, 0]}, ValueError, "ones: expected 0 to the number of trials"),
        (np.zeros((2, 0), int), {}, ValueError, r"ones: expected at least one cell, .*\(2, 0\)"),
        ([1], {"trials": "2"}, ValueError, "trials: expected finite numbers, 0 or more, got '2'"),
        ([1], {"trials": 0.9}, ValueError, "ones: .* got 1 of 0.9 at the index"),
        ([1], {"trials": np.ma.array([1])}, TypeError, "trials: expected a plain array"),
        ([0], {"trials": -1}, ValueError, "trials: expected finite numbers, 0 or more, got -1"),
        ([0], {"trials": np.nan}, ValueError, "trials: expected finite numbers, 0 or more"),
        ([0], {"trials": [np.inf]}, ValueError, "trials: expected finite numbers, 0 or more"),
        ([1], {"trials": [1, 1]}, ValueError, r"trials: expected a number or shape \(1,\)"),
        ([[1], [1]], {"trials": [1, 1]}, ValueError, r"shape \(2, 1\), got \(2,\)"),
        ([1], {"dark_counts": -0.1}, ValueError, "dark_counts: expected finite numbers, 0 or more"),
        ([1], {"dark_counts": np.nan}, ValueError, "dark_counts: .*got nan"),
        ([1], {"dark_counts": [np.inf]}, ValueError, r"dark_counts: .*got \[inf\]"),
        ([1], {"dark_counts": "0"}, ValueError, "dark_counts: .*got '0'"),
        ([1], {"dark_counts": 1j}, ValueError, "dark_counts: .*got 1j"),
        ([1], {"dark_counts": [0.0, 0.1]}, ValueError, r"dark_counts: expected a number or shape"),
        ([1], {"threshold": 0}, ValueError, "threshold: expected a whole number from 1 to 65535"),
        ([1], {"threshold": -2}, ValueError, "threshold: .*got -2"),
        ([1], {"threshold": 1.5}, ValueError, "threshold: .*got 1.5"),
        ([1], {"threshold": 65536}, ValueError, "threshold: .*got 65536"),
    ],
)
def test_arguments_out_of_range_are_refused(ones, options, error, message):
    with pytest.raises(error, match=message):
        jl.Likelihood(ones, **options)


@pytest.mark.parametrize("method", ["value", "gradient_and_curvature", "information"])
@pytest.mark.parametrize(
    ("light", "message"),
    [
        ([1.0, -1e-9, 1.0], "light: expected 0 or more, got -1e-09"),
        ([1.0, np.nan, 1.0], "light: expected 0 or more, got nan"),
        ([1.0, -np.inf, 1.0], "light: expected 0 or more, got -inf"),
        ([1.0, 1.0], r"light: expected a number, or an array of shape \(3,\), got \(2,\)"),
        ([[1.0, 1.0, 1.0]], r"light: expected a number, or an array of shape \(3,\), got \(1, 3\)"),
    ],
)
def test_light_out_of_range_is_refused(method, light, message):
    with pytest.raises(ValueError, match=message):
        getattr(jl.Likelihood([0, 1, 1]), method)(light)


@pytest.mark.filterwarnings("ignore:the matrix subclass")
def test_light_is_a_number_or_an_array_of_the_cells():
    likelihood = jl.Likelihood(np.ones((4, 4), int), trials=4)
    for wrong in (np.ones(4), np.ones((4, 1)), np.ones((1, 4, 4))):
        with pytest.raises(ValueError, match=r"a number, or an array of shape \(4, 4\)"):
            likelihood.value(wrong)
    for wrong in (np.ones((4, 4), complex), np.full((4, 4), "1"), np.ones((4, 4), bool)):
        with pytest.raises(TypeError, match="light: expected real numbers"):
            likelihood.value(wrong)
    gradient, _ = likelihood.gradient_and_curvature(np.matrix(np.ones((4, 4))))
    np.testing.assert_array_equal(gradient, likelihood.gradient_and_curvature(1.0)[0])


def test_a_single_cell_is_no_stack():
    with pytest.raises(ValueError, match="expected cells of a stack"):
        jl.Likelihood(1, trials=4).values(0.5)
