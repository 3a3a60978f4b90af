"""χ² of blocks, and parts of the frames that disagree: the engine against its twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, shift

from jotlight import _engine as engine
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.disagreement import chi_squared, disagreement
from jotlight.motion.displacements.scoring import Template
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


@pytest.mark.parametrize("size", [(1, 9000), (9000, 1), (2, 4500), (3, 3000), (60, 150)])
def test_noise_is_as_likely_at_borders_as_inside(size):
    rng = np.random.default_rng(5)
    p = rng.uniform(0.2, 0.5, size)
    first, second = Sums.zeros(size), Sums.zeros(size)
    for sums, trials in ((first, 40), (second, 100)):
        sums.trials[:], sums.ones[:] = trials, rng.binomial(trials, p)
    template = Template(p.astype(np.float32), np.full(size, 10**6, np.int32))
    for test in disagreement(first, second), chi_squared(first, template):
        borders = test.copy()
        borders[1:-1, 1:-1] = np.nan
        assert np.nanmean(borders) == pytest.approx(1, abs=0.12)
        assert test.mean() == pytest.approx(1, abs=0.07)


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


def random_case(seed, size, trials, threads=None):
    """Return sums and a template of random counts; a part of the pixels has no trials."""
    rng = np.random.default_rng(seed)
    sums = Sums.zeros(size)
    sums.ones, sums.trials = random_counts(rng, size, trials)
    probability = rng.uniform(0.01, 0.99, size).astype(np.float32)
    return sums, Template(probability, rng.integers(0, 50, size, np.int32), threads)


@settings(max_examples=60)
@given(
    st.integers(0, 2**32),
    st.tuples(st.integers(1, 80), st.integers(1, 100)),
    st.sampled_from([0, 1, 8, 128]),
)
def test_chi_squared_is_that_of_the_twin(seed, size, trials):
    sums, template = random_case(seed, size, trials)
    expected = reference.chi_squared(sums.ones, sums.trials, template.probability, template.trials)
    np.testing.assert_allclose(chi_squared(sums, template), expected, rtol=1e-4)


def test_many_trials_do_not_show_small_errors():
    """More trials than 512 count as 512 with the same fraction of ones."""
    size, rng = (60, 70), np.random.default_rng(3)
    probability = rng.uniform(0.1, 0.9, size).astype(np.float32)
    template = Template(probability, np.full(size, 10**6, np.int32))
    shifted = np.clip(probability + rng.normal(0, 0.02, size), 0, 1)

    def sums_of(trials):
        sums = Sums.zeros(size)
        sums.trials[:], sums.ones[:] = trials, np.rint(trials * shifted)
        return sums

    few, many = sums_of(512), sums_of(512 * 1000)
    np.testing.assert_allclose(
        chi_squared(many, template), chi_squared(few, template), rtol=0.2, atol=0.05
    )
    np.testing.assert_allclose(disagreement(many, few), disagreement(few, few), atol=0.01)
    raw = reference.chi_squared(many.ones, many.trials, template.probability, template.trials)
    assert raw.mean() > 100
    assert chi_squared(many, template).mean() < 2.5


def test_the_shift_that_rounding_causes_is_no_disagreement():
    size, rng, trials = (96, 96), np.random.default_rng(4), 400
    image = gaussian_filter(rng.normal(size=size), 2.5, mode="wrap")
    probability = 0.4 + 0.3 * np.tanh(image / image.std())
    template = Template(probability.astype(np.float32), np.full(size, 10**6, np.int32))
    rounded = shift(probability, (-0.4, 0.3), order=5, mode="grid-wrap")
    sums = Sums.zeros(size)
    sums.trials[:], sums.ones[:], sums.frames = trials, rng.binomial(trials, rounded), trials
    inner = np.s_[8:-8, 8:-8]
    assert chi_squared(sums, template)[inner].mean() > 3
    sums.remainders[:] = trials * np.float32([0.4, -0.3])[:, None]
    assert chi_squared(sums, template)[inner].mean() < 1.4


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
