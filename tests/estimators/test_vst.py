import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

import jotlight as jl
from reference import methods

BITS = [1, 2, 3, 9, 16, 100, 4096, 100_000]


def some_counts(bits):
    return np.unique(np.linspace(0, bits, min(bits + 1, 300)).round()).astype(int)


@pytest.mark.parametrize("bits", BITS)
def test_anscombe_is_equation_6(bits):
    counts = some_counts(bits)
    expected = methods.anscombe(counts, bits)
    np.testing.assert_allclose(jl.vst.anscombe(counts, bits), expected, rtol=2e-7)


@pytest.mark.parametrize("bits", BITS)
def test_the_algebraic_inverse_is_equation_7_clipped_to_0_and_k(bits):
    z = np.linspace(*methods.anscombe(np.array([0, bits]), bits), 500).astype(np.float32)
    expected = np.clip(methods.algebraic_inverse(z.astype(float), bits), 0, bits)
    counts = jl.vst.inverse_anscombe(z, bits, inverse="algebraic")
    np.testing.assert_allclose(counts, expected, atol=1e-7 * bits)


@pytest.mark.parametrize("bits", BITS)
def test_the_algebraic_inverse_inverts_anscombe(bits):
    counts = some_counts(bits)
    back = jl.vst.inverse_anscombe(jl.vst.anscombe(counts, bits), bits, inverse="algebraic")
    np.testing.assert_allclose(back, counts, atol=3e-7 * bits)


@pytest.mark.parametrize("bits", BITS)
def test_the_exact_inverse_is_unbiased(bits):
    probability = np.array([1e-4, 0.003, 0.02, 0.1, 0.37, 0.5, 0.8, 0.97, 0.9995])
    mean = np.array([methods.stabilized_moments(p, bits)[0] for p in probability])
    estimate = jl.vst.inverse_anscombe(mean, bits)
    np.testing.assert_allclose(estimate, bits * probability, atol=2e-6 * bits)


@pytest.mark.parametrize("bits", [1, 4, 16, 81])
def test_the_exact_inverse_agrees_with_the_reference(bits):
    z = np.linspace(*methods.anscombe(np.array([0, bits]), bits), 60).astype(np.float32)
    expected = [methods.exact_inverse(float(value), bits) for value in z]
    np.testing.assert_allclose(jl.vst.inverse_anscombe(z, bits), expected, atol=2e-6 * bits)


@pytest.mark.parametrize("bits", [4, 16, 64])
def test_the_algebraic_inverse_is_biased_as_equation_7_predicts(bits):
    mean = np.array([methods.stabilized_moments(p, bits)[0] for p in (0.05, 0.9)])
    algebraic = jl.vst.inverse_anscombe(mean, bits, inverse="algebraic")
    bias = methods.algebraic_inverse(mean, bits) - bits * np.array([0.05, 0.9])
    np.testing.assert_allclose(algebraic - bits * np.array([0.05, 0.9]), bias, atol=1e-5)
    assert (np.abs(bias) > 0.02).all()


@pytest.mark.parametrize("bits", [16, 100, 4096])
@pytest.mark.parametrize("probability", [0.2, 0.5, 0.8])
def test_stabilized_noise_has_the_standard_deviation_noise(bits, probability):
    weights = methods.binom.pmf(np.arange(bits + 1), bits, probability)
    z = jl.vst.anscombe(np.arange(bits + 1), bits)
    deviation = np.sqrt(weights @ (z - weights @ z) ** 2)
    assert deviation == pytest.approx(jl.vst.NOISE, rel=0.5 / bits + 1e-5)


@pytest.mark.parametrize(("share", "expected"), [(0.12, 0.48), (0.03, 0.35), (0.97, 0.35)])
def test_the_noise_is_smaller_where_nearly_all_bits_are_equal(share, expected):
    weights = methods.binom.pmf(np.arange(17), 16, share)
    z = jl.vst.anscombe(np.arange(17), 16)
    deviation = np.sqrt(weights @ (z - weights @ z) ** 2)
    assert deviation == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("inverse", jl.vst.INVERSES)
@pytest.mark.parametrize("bits", [1, 16, 1000])
def test_values_outside_of_the_range_of_anscombe_give_0_or_k(bits, inverse):
    low, high = methods.anscombe(np.array([0, bits]), bits)
    z = [-np.inf, -1e30, -1, 0, low - 1e-3, high + 1e-3, 2 * high, 4 * high, 1e30, np.inf]
    expected = [0] * 5 + [bits] * 5
    np.testing.assert_array_equal(jl.vst.inverse_anscombe(z, bits, inverse=inverse), expected)


@pytest.mark.parametrize("inverse", jl.vst.INVERSES)
@pytest.mark.parametrize("bits", [1, 7, 100_000])
def test_the_inverses_are_monotone(bits, inverse):
    z = np.linspace(-1, methods.anscombe(bits, bits) + 1, 5000)
    counts = jl.vst.inverse_anscombe(z, bits, inverse=inverse)
    assert (np.diff(counts) >= 0).all()
    assert len(np.unique(counts)) > 1000


@pytest.mark.parametrize("shape", [(), (0,), (5,), (2, 3), (2, 3, 4)])
@pytest.mark.parametrize("function", [jl.vst.anscombe, jl.vst.inverse_anscombe])
def test_shape_and_values_do_not_depend_on_the_memory_order(function, shape):
    values = np.array(np.random.default_rng(0).uniform(0.7, 5, shape), order="F")
    result = function(values, 16)
    assert (result.shape, result.dtype) == (shape, np.float32)
    np.testing.assert_array_equal(result.ravel(), function(values.ravel(), 16))


@pytest.mark.parametrize("inverse", jl.vst.INVERSES)
def test_the_number_of_threads_does_not_change_the_values(inverse):
    z = np.linspace(0, 6, 10_001)
    one, all_ = (
        jl.vst.inverse_anscombe(z, 16, inverse=inverse, threads=threads) for threads in (1, None)
    )
    np.testing.assert_array_equal(one, all_)


def test_a_count_of_k_stays_k_where_float32_cannot_represent_k():
    bits = 2**25 - 1
    z = jl.vst.anscombe(bits, bits)
    np.testing.assert_allclose(z, np.sqrt(bits) * np.pi / 2, rtol=1e-3)
    assert jl.vst.inverse_anscombe(z, bits, inverse="algebraic") == bits


@pytest.mark.parametrize(
    ("counts", "bits", "message"),
    [
        ([17], 16, "counts: expected 0 to the number of trials, got 17.0 to 17.0 with up to 16"),
        ([-0.1], 16, "counts: expected 0 to the number of trials"),
        ([np.nan], 16, "counts: expected 0 to the number of trials"),
        ([np.nan, 0], [1, 1], "counts: expected 0 to the number of trials"),
        ([1, 2], [2, 1], "counts: expected 0 to the number of trials"),
        ([0], -1, "trials: expected finite numbers, 0 or more, got -1"),
        ([0], np.nan, "trials: expected finite numbers, 0 or more, got nan"),
        ([0], [1, 2], r"trials: expected a number or shape \(1,\), got \(2,\)"),
    ],
)
def test_anscombe_refuses_counts_outside_of_0_to_k(counts, bits, message):
    with pytest.raises(ValueError, match=message):
        jl.vst.anscombe(counts, bits)


@pytest.mark.parametrize("inverse", jl.vst.INVERSES)
def test_the_inverses_refuse_trials_that_are_not_numbers_from_0_upward(inverse):
    for trials in (-1, np.nan, [np.inf]):
        with pytest.raises(ValueError, match="trials: expected finite numbers, 0 or more"):
            jl.vst.inverse_anscombe([1.0], trials, inverse=inverse)
    with pytest.raises(ValueError, match=r"trials: expected a number or shape \(1,\)"):
        jl.vst.inverse_anscombe([1.0], [1, 2], inverse=inverse)


def real_trials():
    """Return trials of a map: more different values than have tables of their own."""
    return np.concatenate([[0.0, 0.25, 1.0, 2.5], np.geomspace(1, 5000, 400)])


def test_each_count_is_stabilized_by_its_own_trials():
    trials = real_trials()
    counts = np.float32(0.3 * trials)
    expected = np.sqrt(trials + 0.5) * np.arcsin(np.sqrt((counts + 0.375) / (trials + 0.75)))
    z = jl.vst.anscombe(counts, trials)
    np.testing.assert_allclose(z, expected, rtol=1e-6)
    restored = jl.vst.inverse_anscombe(z, trials, inverse="algebraic")
    np.testing.assert_allclose(restored, counts, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("inverse", jl.vst.INVERSES)
def test_a_constant_map_of_trials_equals_a_number(inverse):
    counts = np.arange(13.0)
    z = jl.vst.anscombe(counts, 12)
    np.testing.assert_array_equal(jl.vst.anscombe(counts, np.full(13, 12)), z)
    np.testing.assert_allclose(
        jl.vst.inverse_anscombe(z, np.full(13, 12.0), inverse=inverse),
        jl.vst.inverse_anscombe(z, 12, inverse=inverse),
        atol=1e-5,
    )


@pytest.mark.slow
def test_the_exact_inverse_of_a_map_is_near_the_inverse_of_each_number():
    trials = np.random.default_rng(0).integers(1, 3000, 200)
    fraction = np.random.default_rng(1).random(200)
    z = np.sqrt(trials + 0.5) * np.arcsin(np.sqrt(fraction))
    found = jl.vst.inverse_anscombe(z, trials)
    each = [jl.vst.inverse_anscombe([z[i]], int(trials[i]))[0] for i in range(200)]
    assert (abs(found - each) < 1e-4 * trials).all()
    assert (found >= 0).all()
    assert (found <= trials).all()


@pytest.mark.parametrize("low", [1, 6])
def test_the_exact_inverse_of_a_map_is_near_that_of_each_number_in_its_whole_range(low):
    whole = np.unique(np.geomspace(low, 300, 90).astype(int))
    trials = np.repeat(whole[:, None], 151, axis=1)
    z = np.linspace(0, np.pi / 2, 151) * np.sqrt(trials + 0.5)
    each = [jl.vst.inverse_anscombe(z[i], int(k)) for i, k in enumerate(whole)]
    assert (abs(jl.vst.inverse_anscombe(z, trials) - each) < 1e-4 * trials).all()


def test_the_exact_inverse_of_a_real_number_lies_between_its_neighbors():
    def at(trials):
        ends = jl.vst.anscombe([0.0, trials], trials).astype(float)
        return jl.vst.inverse_anscombe(np.linspace(*ends, 31), trials) / trials

    low, high, found = at(2), at(3), at(2.5)
    assert (found >= np.minimum(low, high) - 1e-6).all()
    assert (found <= np.maximum(low, high) + 1e-6).all()
    np.testing.assert_array_equal(jl.vst.inverse_anscombe([-1.0, 0.5, 3.5], 0), 0)


def test_an_unknown_inverse_is_refused():
    with pytest.raises(ValueError, match="one of exact, algebraic, got 'asymptotic'"):
        jl.vst.inverse_anscombe([1.0], 4, inverse="asymptotic")


def test_nan_is_refused():
    with pytest.raises(ValueError, match="z: expected numbers"):
        jl.vst.inverse_anscombe([1.0, np.nan], 4)


@pytest.mark.slow
@given(hnp.arrays(np.float64, 50, elements=st.floats(-1e6, 1e6)), st.integers(1, 3000))
def test_inverse_transforms_map_any_value_to_the_range_of_counts(z, bits):
    for inverse in jl.vst.INVERSES:
        counts = jl.vst.inverse_anscombe(np.sort(z), bits, inverse=inverse)
        assert (np.diff(counts) >= 0).all()
        assert counts.min() >= 0
        assert counts.max() <= bits


@pytest.mark.parametrize("bits", [10**5, 10**7, 2**31 - 1])
def test_the_exact_inverse_is_unbiased_for_rare_ones_and_zeros(bits):
    mean = np.array([0.01, 0.3, 1, 3, 10, 100, 200, 1000])
    rare = np.arange(1500)
    weights = methods.binom.pmf(rare, bits, mean[:, None] / bits)
    for is_one in (True, False):
        z = methods.anscombe(rare if is_one else bits - rare, bits)
        found = jl.vst.inverse_anscombe(weights @ z, bits)
        # The result is a float32, and so is z.
        rounding = 0 if is_one else 1e-7 * bits + 0.01 * np.sqrt(mean * bits) / np.sqrt(bits)
        expected = mean if is_one else bits - mean
        assert (abs(found - expected) <= 0.003 + 0.002 * mean + rounding).all()


@pytest.mark.parametrize(
    ("bits", "share", "noise"),
    [(16, 0.12, 0.48), (16, 0.03, 0.34), (1, 0.5, 0.37), (2, 0.5, 0.46), (3, 0.5, 0.49)],
)
def test_the_noise_of_few_bits_and_of_rare_ones_is_as_documented(bits, share, noise):
    counts = np.arange(bits + 1)
    values = jl.vst.anscombe(counts, bits)
    weights = binom.pmf(counts, bits, share)
    assert round(np.sqrt(np.cov(values, aweights=weights, ddof=0)), 2) == noise
    assert noise < jl.vst.NOISE
