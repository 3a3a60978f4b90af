"""Flicker behind thresholds above 1: dim pixels follow powers of the light."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import poisson

import jotlight as jl
from jotlight.motion.align import prepare_burst
from jotlight.motion.counts.lights import BlockLights, Lights
from jotlight.motion.counts.reading_counts import counts_of_readings
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.disagreement import chi_squared, disagreement
from jotlight.motion.displacements.flicker import (
    at_brightness,
    change_of_light,
    light_factor,
    without_saturation,
)
from jotlight.motion.displacements.scoring import Template

SIZE = 96, 128


def probability(threshold, rate):
    """Return the probability of as many photons as the threshold, from the Poisson distribution."""
    return poisson.sf(threshold - 1, rate)


def light(threshold):
    """Return the photons per jot and frame of a scene, from dim to bright jots."""
    rows, columns = np.indices(SIZE)
    return threshold * (0.3 + 1.2 * ((rows // 16 + columns // 16) % 4) / 3)


def sums_of(threshold, parts, rng):
    """Return the sums of parts of the frames: pairs of images of photons and numbers of frames."""
    rng = np.random.default_rng(rng)
    ones = sum(rng.binomial(frames, probability(threshold, each)) for each, frames in parts)
    frames = sum(frames for _, frames in parts)
    trials = np.full(SIZE, frames, np.int32)
    zeros = Sums.zeros(SIZE)
    return dataclasses.replace(zeros, ones=ones.astype(np.int32), trials=trials, frames=frames)


def template(threshold, lights=None):
    p = probability(threshold, light(threshold)).astype(np.float32)
    lights = Lights(threshold) if lights is None else lights
    return Template(p, np.full(SIZE, 10_000, np.int32), lights=lights)


@pytest.mark.parametrize("threshold", [2, 3, 6, 40])
def test_the_response_is_the_mean_over_the_frames(threshold):
    factors, weights = (0.4, 1.0, 1.7), (0.5, 0.2, 0.3)
    lights = Lights(threshold, factors, weights)
    rates = np.linspace(0.3, 2, 50, dtype=np.float32) * threshold

    def mean(rate):
        each = [w * probability(threshold, f * rate) for f, w in zip(factors, weights, strict=True)]
        return np.sum(each, axis=0)

    ones, slope = lights.response(rates)
    exact = rates.astype(float)
    np.testing.assert_allclose(ones, mean(exact), atol=2e-5)
    np.testing.assert_allclose(slope, (mean(exact + 1e-4) - mean(exact - 1e-4)) / 2e-4, atol=1e-4)
    np.testing.assert_allclose(lights.inverse(ones)[ones > 1e-3], rates[ones > 1e-3], rtol=1e-2)


def test_the_light_of_blocks_has_the_weights_of_their_frames():
    lights = BlockLights(3, [4, 12, 8, 8], [1, 2])
    lights.factors[0] = 2.0
    assert lights.of([0, 1]) == Lights(3, (2.0, 1.0), (0.25, 0.75))
    assert lights.of([0, 3]) == Lights(3, (2.0,), (1.0,))  # that of block 3 is not known
    assert lights.of([3]) == lights.of([]) == Lights(3)


@pytest.mark.parametrize("threshold", [2, 6])
@pytest.mark.parametrize("factor", [0.6, 0.9, 1.5])
def test_the_template_has_the_light_of_the_block(threshold, factor):
    sums = sums_of(threshold, [(factor * light(threshold), 64)], 0)
    assert change_of_light(template(threshold), sums) == pytest.approx(factor, rel=0.01)
    changed = at_brightness(template(threshold), sums)
    exact = probability(threshold, factor * light(threshold))
    np.testing.assert_allclose(changed.probability, exact, atol=0.01)
    assert chi_squared(sums, changed).mean() == pytest.approx(1, abs=0.1)


def test_a_template_of_frames_in_different_light_shows_that_of_a_block():
    lights = Lights(6, (0.7, 1.4), (0.5, 0.5))
    p = (probability(6, 0.7 * light(6)) + probability(6, 1.4 * light(6))) / 2
    mixed = dataclasses.replace(template(6, lights), probability=p.astype(np.float32))
    sums = sums_of(6, [(1.4 * light(6), 64)], 1)
    assert change_of_light(mixed, sums) == pytest.approx(1.4, rel=0.01)
    exact = probability(6, 1.4 * light(6))
    np.testing.assert_allclose(at_brightness(mixed, sums).probability, exact, atol=0.01)


@pytest.mark.parametrize("threshold", [2, 6])
@pytest.mark.parametrize("factors", [(1.0, 1.5), (1.0, 0.7), (0.8, 1.2, 1.2), (1.2, 0.8, 0.8)])
def test_halves_in_other_light_agree(threshold, factors):
    """The first one may have frames in different light."""
    *several, other = factors
    photons, frames = light(threshold), 128 // len(several)
    first = sums_of(threshold, [(factor * photons, frames) for factor in several], 3)
    second = sums_of(threshold, [(other * photons, 128)], 4)
    weights = (1 / len(several),) * len(several)
    lights = Lights(threshold, tuple(several), weights), Lights(threshold, (other,))
    equal = without_saturation(first, second, lights=lights)
    values = disagreement(*equal)
    # The ones that the light of the others predicts share their noise, so the mean is below 1.
    assert 0.4 < values.mean() < 1.1
    assert np.quantile(values, 0.9) < 1.3 < np.quantile(disagreement(first, second), 0.9)
    for each in equal:
        assert (each.ones >= 0).all()
        assert (each.ones <= each.trials).all()


@pytest.mark.parametrize(("threshold", "factor"), [(3, 1.2), (3, 0.8), (6, 1.5), (6, 0.7)])
def test_a_part_that_changes_still_disagrees(threshold, factor):
    changed = factor * light(threshold)
    changed[20:60, 30:80] *= 0.7
    halves = (
        sums_of(threshold, [(changed, 128)], 5),
        sums_of(threshold, [(light(threshold), 128)], 6),
    )
    lights = Lights(threshold, (factor,)), Lights(threshold)
    assert disagreement(*without_saturation(*halves, lights=lights))[28:52, 38:72].min() > 1.5


@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0, 1.2, 50.0])
def test_factors_are_finite_for_all_ratios(ratio):
    p, lights = template(6).probability, Lights(6)
    for trials in (np.zeros(SIZE, np.int32), np.full(SIZE, 7, np.int32)):
        assert np.isfinite(light_factor(p, trials, ratio, lights))
    nothing = Sums.zeros(SIZE)
    assert without_saturation(nothing, nothing, lights=(lights, lights))[0] is nothing


def merge_brighter_half(threshold, **maps):
    """Return the merged counts of a still scene whose second half is 1.5 times as bright."""
    photo = jl.datasets.photograph("camera")[100:228, 150:310].astype(float)
    sensor = jl.Sensor(frames=128, gain=128 * 1.5 * threshold, threshold=threshold, **maps)
    halves = [
        sensor.replace(gain=factor * sensor.gain).expose(photo / photo.max(), rng=seed).packed
        for seed, factor in enumerate((1.0, 1.5))
    ]
    bits = jl.Bits(np.concatenate(halves), photo.shape[1])
    both = sensor.replace(frames=256, gain=2.5 * sensor.gain)
    return jl.merge(bits, both, motion=jl.align(bits, both, model="none"))


@pytest.mark.slow
@pytest.mark.parametrize(("threshold", "most"), [(1, 0.03), (3, 0.06), (6, 0.12)])
def test_still_scenes_whose_light_changes_are_not_flagged(threshold, most):
    merged = merge_brighter_half(threshold)
    assert merged.flags.mean() < most
    assert merged.acceptance.mean() > 0.985


@pytest.mark.slow
def test_nearly_all_bits_of_jots_that_differ_are_accepted():
    rng = np.random.default_rng(0)
    efficiency, dark_counts = rng.uniform(0.6, 1, (128, 160)), rng.uniform(0, 0.4, (128, 160))
    merged = merge_brighter_half(6, efficiency=efficiency, dark_counts=dark_counts)
    assert merged.acceptance.mean() > 0.95


def test_counts_of_readings_do_not_follow_the_threshold_of_their_sensor():
    sensor = jl.Sensor(frames=32, gain=np.tile([2.0, 6.0], 16), threshold=3)
    converted = counts_of_readings(sensor.expose(np.full((32, 40), 0.5), rng=0), None)
    assert converted.sensor.threshold == 3
    for counts in (converted.counts, converted.counts[4:12]):
        own = converted.sensor.replace(frames=2 * len(counts))
        assert prepare_burst(counts, own)[0].threshold == 1
    plain = jl.Sensor(frames=32, gain=100.0, threshold=3).expose(np.full((32, 40), 0.5), rng=0)
    assert prepare_burst(plain, None)[0].threshold == 3
