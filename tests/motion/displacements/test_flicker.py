"""Flicker: the same scene in more or in less light is still the same scene."""

import dataclasses

import numpy as np
import pytest

from jotlight import _engine as engine
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.disagreement import chi_squared, disagreement
from jotlight.motion.displacements.flicker import at_brightness, light_factor, without_saturation
from jotlight.motion.displacements.scoring import Template

SIZE = 96, 128


def light():
    """Return the photons per jot and frame of a scene, from dark to nearly saturated jots."""
    rows, columns = np.indices(SIZE)
    return 0.05 + 3 * ((rows // 16 + columns // 16) % 4) / 3


def sums_of(photons, frames, rng):
    ones = np.random.default_rng(rng).binomial(frames, -np.expm1(-photons)).astype(np.int32)
    return dataclasses.replace(
        Sums.zeros(SIZE), ones=ones, trials=np.full(SIZE, frames, np.int32), frames=frames
    )


def template():
    return Template((-np.expm1(-light())).astype(np.float32), np.full(SIZE, 10_000, np.int32))


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.3, 2.0])
def test_the_template_has_the_light_of_the_block(factor):
    sums = sums_of(factor * light(), 64, 0)
    found = at_brightness(template(), sums).probability
    np.testing.assert_allclose(found, -np.expm1(-factor * light()), atol=0.01)


def test_templates_stay_if_the_light_does_not_change():
    same = template()
    for frames in (4, 64):
        assert at_brightness(same, sums_of(light(), frames, 1)) is same
    nothing = Sums.zeros(SIZE)
    assert at_brightness(same, nothing) is same
    assert without_saturation(nothing, nothing)[0] is nothing


@pytest.mark.parametrize("factor", [0.6, 1.5])
def test_blocks_in_other_light_agree_with_the_template(factor):
    sums = sums_of(factor * light(), 64, 2)
    values = chi_squared(sums, at_brightness(template(), sums))
    assert values.mean() == pytest.approx(1, abs=0.1)
    # If all ones had the same ratio, bright and dark pixels would disagree.
    assert np.quantile(values, 0.99) < 2.5 < np.quantile(chi_squared(sums, template()), 0.99)


def test_saturated_pixels_agree_if_the_light_changes_little():
    """A change by 2 % of the ones would be many times the zeros of saturated pixels."""
    photons = 2.5 * light()
    same = Template((-np.expm1(-photons)).astype(np.float32), np.full(SIZE, 10_000, np.int32))
    sums = sums_of(1.04 * photons, 64, 4)
    assert at_brightness(same, sums) is not same
    saturated = photons > 7
    assert chi_squared(sums, at_brightness(same, sums))[saturated].mean() < 1.2
    assert chi_squared(sums, same)[saturated].mean() > 1.4


@pytest.mark.parametrize("factor", [0.5, 0.8, 0.9, 1.1, 1.3])
def test_halves_in_other_light_agree(factor):
    first, second = sums_of(factor * light(), 128, 3), sums_of(light(), 128, 4)
    equal = without_saturation(first, second)
    values = disagreement(*equal)
    assert values.mean() == pytest.approx(1, abs=0.15)
    assert np.quantile(values, 0.9) < 1.4 < np.quantile(disagreement(first, second), 0.9)
    ratios = []
    for part in (light() < 0.1, light() > 2):
        total, other = (each.ones[part].sum() for each in equal)
        ratios.append(total / other)
    assert ratios[0] == pytest.approx(ratios[1], rel=0.08)
    for each in equal:
        assert (each.ones >= 0).all()
        assert (each.ones <= each.trials).all()


def test_a_part_that_changes_still_disagrees():
    brighter = 1.2 * light()
    brighter[20:60, 30:80] *= 0.7
    halves = sums_of(brighter, 128, 5), sums_of(light(), 128, 6)
    assert disagreement(*without_saturation(*halves))[28:52, 38:72].min() > 1.5


@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0, 1.2, 50.0])
def test_factors_are_finite_for_all_ratios(ratio):
    p = template().probability
    for trials in (np.zeros(SIZE, np.int32), np.full(SIZE, 7, np.int32)):
        assert np.isfinite(light_factor(p, trials, ratio))


def counts_of(seed, trials, size=(37, 45)):
    """Return random counts, of which some pixels have no trials."""
    rng = np.random.default_rng(seed)
    number = (trials * (rng.random(size) < 0.8)).astype(np.int32)
    return rng.binomial(number, 0.3).astype(np.int32), number


@pytest.mark.parametrize("dtype", [np.int32, np.float32])
def test_brightness_is_the_ratio_of_the_ones(dtype):
    ones, trials = (each.astype(dtype) for each in counts_of(0, 9))
    p = np.random.default_rng(1).uniform(0.1, 0.9, ones.shape).astype(np.float32)
    expected = ones.sum() / (trials * p.astype(float)).sum()
    assert engine.brightness(ones, trials, p, None) == pytest.approx(expected, rel=1e-6)
    nothing = np.zeros_like(ones)
    assert engine.brightness(nothing, nothing, p, 1) == 1
    assert engine.brightness(nothing, trials, p, 1) == 0.1


@pytest.mark.parametrize("dtype", [np.int32, np.float32])
def test_relative_brightness_is_that_where_both_parts_have_trials(dtype):
    first, second = counts_of(2, 20), counts_of(3, 7)
    both = (first[1] > 0) & (second[1] > 0)
    ones = (first[0] / np.maximum(first[1], 1) * second[1])[both].sum()
    found = engine.relative_brightness(*(each.astype(dtype) for each in (*first, *second)), None)
    assert found == pytest.approx(ones / second[0][both].sum(), rel=1e-9)


def test_counts_that_are_not_possible_are_refused():
    ones, trials = counts_of(4, 5)
    p = np.full(ones.shape, 0.5, np.float32)
    with pytest.raises(ValueError, match="numbers of ones"):
        engine.brightness(trials + 1, trials, p, None)
    with pytest.raises(ValueError, match="numbers of ones"):
        engine.relative_brightness(ones, trials, trials + 1, trials, None)
    with pytest.raises(TypeError, match="all int32 or all float32"):
        engine.brightness(ones, trials.astype(np.float32), p, None)
