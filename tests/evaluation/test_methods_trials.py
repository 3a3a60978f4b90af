"""Contract of all methods: numbers of trials that differ from pixel to pixel."""

import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.methods import METHODS

SENSOR = jl.Sensor(frames=16)
IMAGE = np.outer(np.linspace(0.2, 0.9, 24), np.linspace(0.6, 1.0, 32))
COUNTS = SENSOR.expose(IMAGE, rng=0).counts()
NAMES = [name for name, method in METHODS.items() if method.available]


@pytest.fixture(params=NAMES)
def run(request):
    return METHODS[request.param].run


def draw(trials, seed=0):
    """Return counts with the given numbers of trials; the fractional parts hold no reading."""
    probability = 1 - np.exp(-IMAGE)
    return np.random.default_rng(seed).binomial(np.floor(trials).astype(int), probability)


def test_constant_trials_are_those_of_the_sensor(run):
    expected = run(COUNTS, SENSOR)
    for trials in (16, np.full(COUNTS.shape, 16.0)):
        np.testing.assert_array_equal(run(jl.Merged(COUNTS, trials, SENSOR)), expected)
        np.testing.assert_array_equal(run(COUNTS, SENSOR, trials=trials), expected)


def test_bits_and_merged_counts_carry_their_sensor(run):
    bits = SENSOR.expose(IMAGE, rng=0)
    np.testing.assert_array_equal(run(bits), run(bits, SENSOR))
    with pytest.raises(TypeError, match="because counts carry none"):
        run(COUNTS)


def test_a_masked_map_of_trials_is_refused(run):
    with pytest.raises(TypeError, match="trials: expected a plain array, got a masked one"):
        run(COUNTS, SENSOR, trials=np.ma.masked_array(np.full(COUNTS.shape, 16.0), COUNTS > 8))


def test_a_map_of_real_trials_with_zeros_works(run):
    trials = np.linspace(0.5, 40, IMAGE.shape[1]) * np.ones(IMAGE.shape)
    trials[8:11, 12:16] = 0
    counts = draw(trials)
    with pytest.warns(jl.JotlightWarning) if "admm" not in repr(run) else warnings.catch_warnings():
        estimate = run(jl.Merged(counts, trials, SENSOR))
    assert estimate.shape == IMAGE.shape
    assert np.isfinite(estimate).all()
    assert (estimate >= 0).all()
    assert (estimate <= SENSOR.max_intensity).all()
    right = slice(None), slice(16, None)
    assert np.sqrt(np.mean((estimate - IMAGE)[right] ** 2)) < 0.25


@pytest.mark.slow
def test_the_channels_of_merged_counts_are_estimated_one_by_one(run):
    trials = 16 + np.arange(32.0) * np.ones(IMAGE.shape)
    # Of three channels, "held-out" estimates all together.
    color = np.stack([draw(trials, seed) for seed in range(4)], -1)
    estimate = run(jl.Merged(color, np.stack([trials] * 4, -1), SENSOR, channel_axis=-1))
    for channel in range(4):
        alone = run(jl.Merged(color[..., channel], trials, SENSOR))
        np.testing.assert_allclose(estimate[..., channel], alone, atol=1e-6)


def test_trials_beside_data_that_state_them_are_refused(run):
    with pytest.raises(TypeError, match="trials: expected none, because Merged state their own"):
        run(jl.Merged(COUNTS, 16, SENSOR), trials=16)


def test_merged_counts_have_an_uncertainty():
    trials = np.where(np.arange(32) < 16, 8.5, 64.0) * np.ones(IMAGE.shape)
    trials[0, 0] = 0
    counts = draw(trials)
    result = jl.uncertainty(jl.Merged(counts, trials, SENSOR), method="mle")
    np.testing.assert_array_equal(result.dead, trials == 0)
    inside = (counts > 0.5) & (counts < trials - 0.5) & (counts < trials * (1 - np.exp(-1)))
    fraction, number = (counts / np.maximum(trials, 1))[inside], trials[inside]
    expected = np.sqrt(fraction / (1 - fraction) / number)
    np.testing.assert_allclose(result.standard_error[inside], expected, rtol=1e-5)
    same = jl.uncertainty(COUNTS, SENSOR, trials=16)
    expected = jl.uncertainty(COUNTS, SENSOR)
    for name in ("standard_error", "low", "high", "unlit", "saturated", "dead"):
        np.testing.assert_array_equal(getattr(same, name), getattr(expected, name))


def test_an_untied_network_refuses_merged_counts():
    network = jl.Network.initial(SENSOR, tied=False)
    with pytest.raises(TypeError, match=r"expected Bits, .*, got Merged; a tied network"):
        network.reconstruct(jl.Merged(COUNTS, 16, SENSOR))
