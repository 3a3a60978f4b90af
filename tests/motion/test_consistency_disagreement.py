"""Whether two parts of the frames disagree: the engine against its twin, and simulated parts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jotlight import _engine as engine
from jotlight.motion.blocks import Sums
from jotlight.motion.consistency import (
    disagreement,
)
from moving import random_counts
from reference import motion as reference


@settings(max_examples=60)
@given(
    st.integers(0, 2**32),
    st.tuples(st.integers(1, 80), st.integers(1, 100)),
    st.sampled_from([0, 1, 8, 1000]),
)
def test_the_disagreement_in_squares_is_that_of_the_twin(seed, size, trials):
    arguments = two_parts(seed, size, trials)
    expected = reference.disagreement(*arguments)
    found = np.empty(expected.shape, np.float32)
    engine.disagreement(*arguments, found, None)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3)


def two_parts(seed, size, trials):
    """Return random ones and trials of two parts."""
    rng = np.random.default_rng(seed)
    return [each for _ in range(2) for each in random_counts(rng, size, trials)]


@pytest.mark.parametrize("level", engine.cpu_levels())
def test_any_number_of_threads_gives_the_same_disagreement(level):
    arguments = two_parts(1, (97, 61), 9)
    engine.choose_cpu_level(level)
    try:
        found = np.empty((3, 2, 25, 16), np.float32)
        for threads, out in enumerate(found, 1):
            engine.disagreement(*arguments, out, threads)
    finally:
        engine.choose_cpu_level(None)
    np.testing.assert_array_equal(found[1:], found[[0, 0]])


@pytest.mark.parametrize("brightness", [1, 0.25, 0.5, 1.3, 2])
def test_parts_that_agree_disagree_by_about_1_except_where_one_has_changed(brightness):
    rng = np.random.default_rng(3)
    p = rng.uniform(0.05, 0.4, (160, 200))
    first, second = Sums.zeros(p.shape), Sums.zeros(p.shape)
    first.trials[:], second.trials[:] = 40, 100
    first.ones[:] = rng.binomial(40, p)
    second.ones[:] = rng.binomial(100, brightness * p)
    found = disagreement(first, second)
    assert found.mean() == pytest.approx(1, abs=0.07)
    assert np.mean(found > 1.4) < 0.01
    first.ones[60:100, 80:120] = rng.binomial(40, p[60:100, 80:120][::-1])
    found = disagreement(first, second)
    assert found[70:90, 90:110].min() > 1.4
    assert np.mean(found[:40] > 1.4) < 0.01
    first.trials[:] = first.ones[:] = 0
    np.testing.assert_allclose(disagreement(first, second), 1)


def test_parts_that_do_not_fit_are_refused():
    good = [np.zeros((5, 8), np.int32), np.full((5, 8), 2, np.int32)] * 2
    out = np.zeros((2, 2, 2), np.float32)
    more, wide = np.full((5, 8), 3, np.int32), np.zeros((5, 9), np.int32)
    for wrong, message in (
        ([more, *good[1:], out], "expected 0 to that of trials"),
        ([*good[:2], more, good[3], out], "expected 0 to that of trials"),
        ([*good[:3], wide, out], "numbers of trials: expected \\(5, 8\\)"),
        ([*good, out[:, :1].copy()], "output: expected \\(2, 2, 2\\)"),
        ([np.zeros((0, 8), np.int32)] * 4 + [out], "at least one pixel"),
    ):
        with pytest.raises(ValueError, match=message):
            engine.disagreement(*wrong, None)
