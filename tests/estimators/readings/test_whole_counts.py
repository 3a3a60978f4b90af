"""Whole numbers of ones: sums along a row stay, and debts are paid."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import jotlight._engine as engine
from jotlight.estimators.readings.whole_counts import diffuse, whole_counts
from reference import methods


@settings(max_examples=50)
@given(values=arrays(np.float64, (3, 40), elements=st.floats(0, 20)))
def test_sums_from_the_left_are_kept_within_one(values):
    whole = diffuse(values, np.ones(values.shape, bool))
    assert (whole == np.rint(whole)).all()
    assert (whole >= 0).all()
    assert np.abs(np.cumsum(values - whole, axis=1)).max() <= 1 + 1e-9


def test_debts_are_paid_by_the_next_pixels():
    whole = diffuse(np.array([[-0.75, 0.5, 0.5, 1.0, 1.0]]), np.ones((1, 5), bool))
    np.testing.assert_array_equal(whole, [[0, 0, 0, 1, 1]])
    # No more than one of them is.
    whole = diffuse(np.array([[-50.0, 1.5, 1.0, 1.0]]), np.ones((1, 4), bool))
    np.testing.assert_array_equal(whole, [[0, 0, 1, 1]])


def test_saturated_pixels_get_no_part_of_a_zero():
    """Such a part pulled their estimates down, the more, the higher the threshold is."""
    ones, trials = whole_counts(np.full((2, 9), 16.05), np.full((2, 9), 16.05))
    np.testing.assert_array_equal(trials, ones)
    ones, trials = whole_counts(np.full((2, 9), 15.05), np.full((2, 9), 16.0))
    assert trials.sum() - ones.sum() == pytest.approx(0.95 * 18, abs=1)


@pytest.mark.parametrize("shape", [(0, 4), (4, 0), (1, 1), (8, 64), (43, 65), (300, 207)])
def test_whole_numbers_are_those_of_the_twin_bit_for_bit(shape):
    rng = np.random.default_rng(0)
    values = rng.uniform(-2, 20, shape) * rng.choice([0, 1e-9, 1, 1e7], shape)
    is_known = rng.random(shape) < 0.9
    expected = methods.diffuse(values, is_known)
    assert diffuse(values, is_known).tobytes() == expected.tobytes()
    for threads in (1, 2, 5):
        out = np.full(shape, np.nan)
        engine.diffuse(values, is_known, out, threads)
        assert out.tobytes() == expected.tobytes()
    strided, known = np.asfortranarray(values)[::-2, ::3], is_known[::-2, ::3]
    expected = methods.diffuse(strided, known)
    assert diffuse(strided, known).tobytes() == expected.tobytes()
