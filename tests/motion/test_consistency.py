"""χ² of blocks: the engine against its twin, and blocks that agree or not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jotlight import _engine as engine
from jotlight.motion.blocks import Sums
from jotlight.motion.consistency import chi_squared
from jotlight.motion.scoring import Template
from reference import motion as reference


def random_case(seed, size, trials, threads=None):
    """Return sums and a template of random counts; a part of the pixels has no trials."""
    rng = np.random.default_rng(seed)
    counts = (trials * (rng.random(size) < 0.8)).astype(np.int32)
    counts[size[0] // 2] = 0
    sums = Sums.zeros(size)
    sums.trials, sums.ones = counts, rng.binomial(counts, 0.4).astype(np.int32)
    probability = rng.uniform(0.01, 0.99, size).astype(np.float32)
    return sums, Template(probability, rng.integers(0, 50, size, np.int32), threads)


@settings(max_examples=60)
@given(
    st.integers(0, 2**32),
    st.tuples(st.integers(1, 80), st.integers(1, 100)),
    st.sampled_from([0, 1, 8, 1000]),
)
def test_chi_squared_is_that_of_the_twin(seed, size, trials):
    sums, template = random_case(seed, size, trials)
    expected = reference.chi_squared(sums.ones, sums.trials, template.probability, template.trials)
    np.testing.assert_allclose(chi_squared(sums, template), expected, rtol=1e-4)


@pytest.mark.parametrize("level", engine.cpu_levels())
@pytest.mark.parametrize("size", [(1, 1), (3, 200), (97, 61)])
def test_any_number_of_threads_gives_the_same_chi_squared(level, size):
    engine.choose_cpu_level(level)
    try:
        one, *others = (chi_squared(*random_case(1, size, 9, threads)) for threads in (1, 2, 3))
    finally:
        engine.choose_cpu_level(None)
    for other in others:
        np.testing.assert_array_equal(one, other)


def test_chi_squared_of_counts_that_agree_is_about_1():
    rng = np.random.default_rng(2)
    size, sums = (200, 200), Sums.zeros((200, 200))
    probability = rng.uniform(0.1, 0.9, size)
    sums.trials[:] = 20
    sums.ones[:] = rng.binomial(20, probability)
    template = Template(probability.astype(np.float32), np.full(size, 10**6, np.int32))
    found = chi_squared(sums, template)
    assert found.mean() == pytest.approx(1, abs=0.05)
    sums.ones[80:120, 80:120] = rng.binomial(20, 1 - probability[80:120, 80:120])
    changed = chi_squared(sums, template)
    assert changed[90:110, 90:110].min() > 2.5
    # The changed part has a slightly different mean, which counts as the brightness of the block.
    np.testing.assert_allclose(changed[:70], found[:70], rtol=0.1, atol=0.01)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ones": np.zeros((5, 7), np.int32)}, "numbers of ones: expected \\(5, 8\\)"),
        ({"ones": np.full((5, 8), 3, np.int32)}, "expected 0 to that of trials"),
        ({"p": np.full((5, 8), np.nan, np.float32)}, "numbers above 0 and below 1"),
        ({"of_template": np.ones((5, 9), np.int32)}, "trials of the template"),
        ({"out": np.zeros((4, 8), np.float32)}, "output: expected \\(5, 8\\)"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(changes, message):
    arguments = {
        "ones": np.zeros((5, 8), np.int32),
        "trials": np.full((5, 8), 2, np.int32),
        "p": np.full((5, 8), 0.5, np.float32),
        "of_template": np.ones((5, 8), np.int32),
        "out": np.zeros((5, 8), np.float32),
    }
    with pytest.raises(ValueError, match=message):
        engine.chi_squared(*{**arguments, **changes}.values(), None)
