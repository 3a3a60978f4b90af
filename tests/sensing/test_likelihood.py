import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp
from scipy.special import gammainc, gammaincc, xlogy

import jotlight as jl

RANDOM = np.random.default_rng(0)
THRESHOLDS = [1, 2, 3, 5, 20, 100]
NEAR_THRESHOLDS = np.array(THRESHOLDS)[:, None] * [0.9, 0.99, 0.999, 1.0, 1.001, 1.01, 1.2]
LIGHTS = np.concatenate([np.geomspace(1e-12, 1e4, 33), NEAR_THRESHOLDS.ravel()])
DIGITS = 1e-12
UNDERFLOW = 1e-290
SIZES = [1, 15, 16, 17, 4095, 4096, 4097, 3 * 4096 + 21]


class Exact:
    """What one bit says of its rate: P' = s^(q - 1) exp(-s) / (q - 1)!, the rest by calculus."""

    def __init__(self, threshold, rate):
        rate = mp.mpf(rate)
        fires = mp.gammainc(threshold, 0, rate, regularized=True)
        dark = mp.gammainc(threshold, rate, mp.inf, regularized=True)
        slope = rate ** (threshold - 1) * mp.exp(-rate) / mp.factorial(threshold - 1)
        bend = slope * ((threshold - 1) / rate - 1)
        self.log_fires = mp.log(fires) if dark > 0.5 else mp.log1p(-dark)
        self.log_dark = mp.log(dark) if fires > 0.5 else mp.log1p(-fires)
        self.fires = slope / fires, (slope / fires) ** 2 - bend / fires
        self.dark = -slope / dark, (slope / dark) ** 2 + bend / dark
        self.information = slope**2 / fires / dark


def close(found, exact, digits=DIGITS):
    return abs(found - exact) <= digits * abs(exact) + UNDERFLOW


@pytest.fixture(autouse=True)
def fifty_digits():
    with mp.workdps(50):
        yield


def seen(ones, trials, light, **options):
    """Value, gradient, curvature and information of one cell."""
    cell = jl.Likelihood([ones], trials, **options)
    return (
        cell.value([light]),
        *np.ravel(cell.gradient_and_curvature([light])),
        *cell.information([light]),
    )


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_one_bit_that_fired_is_right_to_twelve_digits(threshold):
    for light in LIGHTS:
        exact = Exact(threshold, light)
        found = seen(1, 1, light, threshold=threshold)
        expected = exact.log_fires, *exact.fires, exact.information
        assert all(map(close, found, expected)), (light, found, expected)


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_one_bit_that_stayed_dark_is_right_to_twelve_digits(threshold):
    for light in LIGHTS:
        exact = Exact(threshold, light)
        value, gradient, curvature, information = seen(0, 1, light, threshold=threshold)
        assert close(value, exact.log_dark), light
        assert close(gradient, exact.dark[0]), light
        assert close(information, exact.information), light
        if threshold == 1:
            assert curvature == 0
        else:
            assert close(curvature, exact.dark[1]), light


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_bits_add_up_and_see_the_dark_counts_too(threshold):
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
        terms = ones[i] * exact.fires[0], zeros * exact.dark[0]
        assert abs(gradient[i] - sum(terms)) <= DIGITS * (terms[0] - terms[1]) + UNDERFLOW
        assert close(curvature[i], ones[i] * exact.fires[1] + zeros * exact.dark[1])
        assert close(information[i], int(trials[i]) * exact.information)
        value = ones[i] * exact.log_fires + zeros * exact.log_dark
        assert close(jl.Likelihood([ones[i]], int(trials[i]), threshold=threshold,
                                   dark_counts=dark[i]).value([light[i]]), value)  # fmt: skip
        total, size = total + value, size + abs(value)
    assert abs(cells.value(light) - total) <= DIGITS * size


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_slopes_are_those_of_finite_differences(threshold):
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
def test_information_is_the_curvature_that_all_counts_have_on_average(threshold):
    light, trials = 0.6 * threshold, 12
    fires = float(gammainc(threshold, light))
    counts = np.arange(trials + 1)
    chances = [math.comb(trials, k) * fires**k * (1 - fires) ** (trials - k) for k in counts]
    cells = jl.Likelihood(counts, trials, threshold=threshold)
    gradient, curvature = cells.gradient_and_curvature(light)
    information = cells.information(light)
    np.testing.assert_allclose(information, chances @ curvature, rtol=1e-12)
    np.testing.assert_allclose(information, chances @ gradient**2, rtol=1e-12)
    assert chances @ gradient == pytest.approx(0, abs=1e-12 * trials)


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_a_bit_that_cannot_be_has_no_likelihood(threshold):
    assert jl.Likelihood([1, 0], 2, threshold=threshold).value(0.0) == -np.inf
    assert jl.Likelihood([0, 0], 2, threshold=threshold).value(0.0) == 0
    with_dark = jl.Likelihood([1, 0], 2, threshold=threshold, dark_counts=0.5)
    expected = Exact(threshold, 0.5).log_fires + 3 * Exact(threshold, 0.5).log_dark
    assert close(with_dark.value(0.0), expected)


@pytest.mark.parametrize("threshold", THRESHOLDS)
@pytest.mark.parametrize("light", [0.0, 5e-324, 1e-200, 1e-12])
def test_slopes_are_finite_and_rise_towards_the_dark(threshold, light):
    gradient, curvature = jl.Likelihood([0, 1, 9], 9, threshold=threshold).gradient_and_curvature(
        light
    )
    assert np.isfinite([gradient, curvature]).all()
    assert gradient[0] <= 0 < 1e11 < gradient[1] < gradient[2]
    assert 0 <= curvature[0] < 1e22 < curvature[1] < curvature[2]


def test_information_in_the_dark_is_the_limit():
    information = [jl.Likelihood([0], 7, threshold=q).information(0.0)[0] for q in (1, 2, 3, 20)]
    assert information[0] > 1e100
    assert information[1] == pytest.approx(14, rel=1e-12)
    assert information[2:] == pytest.approx([0, 0], abs=1e-100)


@pytest.mark.parametrize("threshold", THRESHOLDS)
@pytest.mark.parametrize("light", [0.0, 0.3, 1e4])
def test_a_dead_cell_says_nothing(threshold, light):
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


def cells_of(shape, threshold, **options):
    trials = RANDOM.integers(0, 30, shape)
    ones = RANDOM.integers(0, trials + 1)
    dark = RANDOM.uniform(0, 0.2, shape) * (RANDOM.random(shape) < 0.8)
    light = threshold * RANDOM.gamma(0.5, 2, shape) + 1e-9
    return jl.Likelihood(ones, trials, threshold=threshold, dark_counts=dark, **options), light


@pytest.mark.parametrize("size", SIZES)
def test_any_number_of_cells_of_one_photon_is_as_the_formula_has_it(size):
    cells, light = cells_of(size, 1)
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
    fires = np.log(-np.expm1(-rate))
    assert cells.value(light) == pytest.approx(math.fsum(ones * fires - zeros * rate), rel=1e-13)


@pytest.mark.parametrize("size", SIZES)
def test_any_number_of_cells_of_more_photons_is_as_the_formula_has_it(size):
    cells, light = cells_of(size, 3)
    ones, zeros = cells.ones, cells.trials - cells.ones
    rate = light + cells.dark_counts
    fires, dark = gammainc(3, rate), gammaincc(3, rate)
    slope = rate**2 * np.exp(-rate) / 2
    terms = ones * slope / fires, zeros * slope / dark
    np.testing.assert_allclose(
        cells.gradient_and_curvature(light)[0], terms[0] - terms[1], rtol=1e-11, atol=1e-12 * 30
    )
    np.testing.assert_allclose(
        cells.information(light), cells.trials * slope**2 / fires / dark, rtol=1e-11, atol=1e-290
    )
    value = math.fsum(xlogy(ones, fires) + xlogy(zeros, dark))
    assert cells.value(light) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("threshold", [1, 4])
def test_cells_do_not_know_of_each_other(threshold):
    cells, light = cells_of(50, threshold)
    together = np.array([*cells.gradient_and_curvature(light), cells.information(light)])
    for i in range(50):
        alone = seen(
            cells.ones[i],
            cells.trials[i],
            light[i],
            threshold=threshold,
            dark_counts=cells.dark_counts[i],
        )
        np.testing.assert_array_equal(together[:, i], alone[1:])


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_shape_of_the_cells_changes_nothing(threshold):
    flat, light = cells_of(120, threshold)
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
def test_a_single_number_stands_for_all_cells(threshold):
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
def test_the_layout_of_the_arrays_changes_nothing(threshold):
    cells, light = cells_of((40, 30), threshold)
    turned = jl.Likelihood(
        np.asfortranarray(cells.ones),
        cells.trials[::-1][::-1],
        threshold=threshold,
        dark_counts=np.asfortranarray(cells.dark_counts),
    )
    there = np.asfortranarray(light)
    assert turned.value(there) == cells.value(light)
    np.testing.assert_array_equal(
        turned.gradient_and_curvature(there), cells.gradient_and_curvature(light)
    )
    np.testing.assert_array_equal(turned.information(there), cells.information(light))


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_number_of_threads_changes_no_bit(threshold):
    cells, light = cells_of((131, 97), threshold)
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


@pytest.mark.parametrize("threshold", [1, 3])
def test_very_many_cells_are_handled_in_parts(threshold, monkeypatch):
    cells, light = cells_of(20_000, threshold)
    whole = [
        *cells.gradient_and_curvature(light),
        cells.information(light),
        cells.proximal(light, 2.0, max_light=5.0),
    ]
    value = cells.value(light)
    monkeypatch.setattr("jotlight.sensing.likelihood._MAX_CELLS", 7001)
    parts = [
        *cells.gradient_and_curvature(light),
        cells.information(light),
        cells.proximal(light, 2.0, max_light=5.0),
    ]
    np.testing.assert_array_equal(parts, whole)
    assert cells.value(light) == pytest.approx(value, rel=1e-13)


def test_as_many_bits_as_fit_into_a_count_are_taken():
    most = 2**31 - 1
    cells = jl.Likelihood([0, most, 1], most)
    exact = Exact(1, 0.5)
    expected = (most + 1) * exact.log_fires + (2 * most - 1) * exact.log_dark
    assert close(cells.value(0.5), expected)


@pytest.mark.parametrize(
    ("ones", "options", "error", "message"),
    [
        ([1.0], {}, TypeError, "ones: expected whole numbers, got float64"),
        (["1"], {}, TypeError, "ones: expected whole numbers"),
        (np.ma.array([1]), {}, TypeError, "ones: expected a plain array, got a masked one"),
        ([-1], {}, ValueError, r"ones: expected 0 to 2\*\*31 - 1, got -1 to -1"),
        ([2**31], {"trials": 3}, ValueError, r"ones: expected 0 to 2\*\*31 - 1, got 2147483648"),
        ([0, 3], {"trials": 2}, ValueError, "ones: expected 0 to as many as there are trials"),
        ([2], {}, ValueError, "ones: .* got 2 to 2 with up to 1 trials"),
        ([1, 1], {"trials": [2, 0]}, ValueError, "ones: expected 0 to as many as there are trials"),
        (np.zeros((2, 0), int), {}, ValueError, r"ones: expected at least one cell, .*\(2, 0\)"),
        ([1], {"trials": 2.0}, TypeError, "trials: expected whole numbers, got float64"),
        ([1], {"trials": np.ma.array([1])}, TypeError, "trials: expected a plain array"),
        ([0], {"trials": -1}, ValueError, r"trials: expected 0 to 2\*\*31 - 1"),
        ([0], {"trials": 2**31}, ValueError, r"trials: expected 0 to 2\*\*31 - 1"),
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
def test_bits_that_cannot_be_are_refused(ones, options, error, message):
    with pytest.raises(error, match=message):
        jl.Likelihood(ones, **options)


@pytest.mark.parametrize("method", ["value", "gradient_and_curvature", "information"])
@pytest.mark.parametrize(
    ("light", "message"),
    [
        ([1.0, -1e-9, 1.0], "light: expected 0 or more, got -1e-09"),
        ([1.0, np.nan, 1.0], "light: expected 0 or more, got nan"),
        ([1.0, -np.inf, 1.0], "light: expected 0 or more, got -inf"),
        ([1.0, 1.0], r"light: expected shape \(3,\), got \(2,\)"),
        ([[1.0, 1.0, 1.0]], r"light: expected shape \(3,\), got \(1, 3\)"),
    ],
)
def test_light_that_cannot_be_is_refused(method, light, message):
    with pytest.raises(ValueError, match=message):
        getattr(jl.Likelihood([0, 1, 1]), method)(light)
