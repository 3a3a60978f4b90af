"""K-conditioned networks for any numbers of trials."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.trial_levels import local_trials
from jotlight.networks.inference.trials_map import denoise_map
from reference import trials_map as reference

NETWORK = jl.pretrained(jl.Sensor())
IMAGE = 0.2 + 0.5 * np.outer(np.hanning(80), np.hanning(96)) + 0.2 * (np.arange(96) > 40)
SENSOR = jl.Sensor(frames=16)


def draw(trials, seed=0):
    return np.random.default_rng(seed).binomial(trials, 1 - np.exp(-IMAGE))


def psnr(estimate):
    return float(jl.metrics.psnr(estimate, IMAGE))


def intensity(probability):
    return np.clip(-np.log1p(-np.clip(probability, 0, 1 - 1e-7)), 0, 1)


def test_a_map_of_trials_is_denoised_at_levels():
    trials = np.where(np.arange(96) < 48, 4, 64) * np.ones((80, 1), int)
    counts = draw(trials)
    estimate = NETWORK.reconstruct(counts, SENSOR, trials=trials)
    probability = denoise_map(NETWORK, counts.astype(np.float32), trials.astype(np.float32))
    np.testing.assert_allclose(estimate, intensity(probability), atol=1e-4)
    assert psnr(estimate) > psnr(NETWORK.reconstruct(counts, SENSOR, trials=64)) + 3


@pytest.mark.parametrize(("trials", "gain"), [(1000, 1.0), (4000, 4.5)])
def test_more_trials_than_the_range_are_served(trials, gain):
    counts = draw(trials)
    estimate = NETWORK.reconstruct(counts, jl.Sensor(frames=trials))
    expected = reference.denoise_map(NETWORK, counts, np.full(counts.shape, float(trials)))
    np.testing.assert_allclose(estimate, intensity(expected), atol=1e-4)
    clamped = NETWORK.denoise_probability((counts / trials).astype(np.float32), 256)
    assert psnr(estimate) > psnr(intensity(clamped)) + gain


def test_bits_beyond_the_range_are_as_good_as_counts():
    estimate = NETWORK.reconstruct(draw(1000), jl.Sensor(frames=1000))
    bits = jl.Sensor(oversampling=2, frames=250).expose(IMAGE, rng=0)
    assert psnr(NETWORK.reconstruct(bits)) == pytest.approx(psnr(estimate), abs=1)


def test_fewer_trials_than_the_range_are_denoised_at_its_lower_end():
    network = jl.Network(NETWORK.layers, NETWORK.sensor, trials_range=(8, 256))
    trials = np.where(np.arange(96) < 48, 2, 32) * np.ones((80, 1), int)
    estimate = network.reconstruct(draw(trials), SENSOR, trials=trials)
    assert np.isfinite(estimate).all()
    assert psnr(estimate) > 18


def test_a_few_dead_jots_are_one_run():
    mask = np.random.default_rng(0).random((160, 192)) < 0.03
    sensor = jl.Sensor(oversampling=2, frames=4, mask=mask)
    bits = sensor.expose(IMAGE, rng=0)
    estimate = NETWORK.reconstruct(bits)
    valid = 16.0 - 4 * mask.reshape(80, 2, 96, 2).sum((1, 3))
    assert valid.min() > 0
    level = local_trials(valid)
    assert level in (15, 16)
    fraction = (bits.counts() / valid).astype(np.float32)
    expected = intensity(NETWORK.denoise_probability(fraction, level))
    np.testing.assert_allclose(estimate, expected, atol=1e-5)
    assert psnr(estimate) > psnr(NETWORK.reconstruct(draw(16), SENSOR)) - 0.7


@pytest.mark.parametrize(("trials", "run"), [(16, 16), (16.6, 16), (16.7, 17), (256, 256)])
def test_equal_trials_are_one_run_up_to_the_range(trials, run):
    counts = draw(int(trials))
    estimate = NETWORK.reconstruct(counts, SENSOR, trials=trials)
    fraction = (counts / trials).astype(np.float32)
    expected = intensity(NETWORK.denoise_probability(fraction, run))
    np.testing.assert_allclose(estimate, expected, atol=1e-5)


@pytest.mark.parametrize(("trials", "runs"), [(1000, 2), (4096, 2), (5000, 3)])
def test_each_factor_of_16_above_the_range_is_one_more_run(trials, runs):
    counts, levels = draw(trials).astype(np.float32), []
    expected = reference.denoise_map(NETWORK, counts, np.full_like(counts, trials), levels)
    assert levels == [256] * runs
    estimate = NETWORK.reconstruct(draw(trials), SENSOR, trials=trials)
    np.testing.assert_allclose(estimate, intensity(expected), atol=1e-5)


def test_dark_counts_of_the_pixels_are_subtracted():
    dark = np.where(np.arange(96) % 2, 0.0, 0.3) * np.ones((80, 1))
    trials = np.full((80, 96), 100)
    counts = np.random.default_rng(1).binomial(trials, 1 - np.exp(-IMAGE - dark))
    merged = jl.Merged(counts, trials, jl.Sensor(frames=100), dark_counts=dark)
    assert psnr(NETWORK.reconstruct(merged)) > 37


def test_merged_counts_may_have_other_dark_counts_than_their_sensor():
    counts = np.random.default_rng(1).binomial(100, 1 - np.exp(-IMAGE - 0.3))
    sensor = jl.Sensor(frames=100, dark_counts=0.3, efficiency=0.9)
    expected = NETWORK.reconstruct(counts, sensor)
    for dark_counts in (0.3, np.full(IMAGE.shape, 0.3)):
        merged = jl.Merged(
            counts, 100.0, jl.Sensor(frames=100), dark_counts=dark_counts, efficiency=0.9
        )
        np.testing.assert_allclose(NETWORK.reconstruct(merged), expected, atol=1e-5)
