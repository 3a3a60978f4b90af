"""Networks that estimate the probability of a 0, for bright sensors."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.inference.trials_map import denoise_fractions
from reference.trials_map import denoise_map

NETWORK = jl.pretrained(jl.Sensor(frames=16))
IMAGE = jl.datasets.photograph()[100:160, 180:250]


def test_the_probability_of_a_zero_is_one_minus_that_of_a_one():
    fraction = np.random.default_rng(0).random((40, 50), np.float32)
    for trials in (1, 16, 256):
        ones = NETWORK.denoise_probability(1 - fraction, trials)
        (found,) = denoise_fractions(NETWORK, fraction[None], [trials], zeros=True)
        np.testing.assert_allclose(found, 1 - np.clip(ones, 0, 1), atol=1e-6)


def test_only_bright_sensors_need_zeros():
    assert NETWORK.estimates_zeros(jl.Sensor(gain=5.0))
    assert NETWORK.estimates_zeros(jl.Sensor(max_intensity=5.0))
    assert not NETWORK.estimates_zeros(jl.Sensor(gain=3.0))
    assert not NETWORK.estimates_zeros(jl.Sensor(gain=40.0, threshold=2))
    linear = dataclasses.replace(NETWORK.layers[-1], coefficients=None)
    layers = [*NETWORK.layers[:-1], linear]
    network = jl.Network(layers, jl.Sensor(), trials_range=NETWORK.trials_range)
    assert not network.estimates_zeros(jl.Sensor(gain=5.0))


@pytest.mark.parametrize("trials", [16, 256, 4000])
def test_estimates_do_not_jump_where_sensors_become_bright(trials):
    # Both sensors see the same light. The limit of the intensity makes one of them bright.
    dark = jl.Sensor(frames=trials, gain=2.0 * trials, max_intensity=1.9)
    bright = dark.replace(max_intensity=2.1)
    assert [NETWORK.estimates_zeros(each) for each in (dark, bright)] == [False, True]
    counts = dark.expose(IMAGE, rng=0).counts()
    estimate = np.minimum(NETWORK(counts, bright), np.float32(1.9))
    np.testing.assert_allclose(estimate, NETWORK(counts, dark), atol=2e-6)


@pytest.mark.parametrize("frames", [16, 256, 1000])
def test_bright_estimates_are_not_those_of_rounded_probabilities(frames):
    sensor = jl.Sensor(frames=frames, gain=25.0 * frames)
    estimate = NETWORK(sensor.expose(IMAGE, rng=0).counts(), sensor).astype(np.float64)
    probability = -np.expm1(-25 * estimate[estimate > 0.2])
    # In float32, all numbers from 1/2 to 1 are multiples of 2^-24.
    steps = probability * 2**24
    assert np.mean(abs(steps - np.rint(steps)) < 0.05) == pytest.approx(0.1, abs=0.05)


@pytest.mark.parametrize("frames", [64, 1000])
def test_maps_of_trials_agree_with_estimates_from_ones(frames):
    sensor = jl.Sensor(frames=frames, gain=10.0 * frames)
    counts = sensor.expose(IMAGE, rng=0).counts()
    trials = np.where(np.arange(70) < 30, 1.3, 1.0) * np.full((60, 1), frames)
    estimate = NETWORK(counts, sensor, trials=trials)
    ones = denoise_map(NETWORK, counts.astype(np.float32), trials.astype(np.float32))
    expected = np.clip(-np.log1p(-ones.astype(np.float64)) / 10, 0, 1)
    np.testing.assert_allclose(estimate, expected, atol=4e-4)
    # It is not the estimate from ones itself, in which bright pixels are rounded.
    assert not np.array_equal(estimate, expected.astype(np.float32))
