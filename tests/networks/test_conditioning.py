"""K-conditioned networks: interpolated parameters."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.conditioning import conditioning_weights, count_sets
from jotlight.networks.graph import size_divisor
from reference import deep
from reference.deep import conditional_network, random_counts
from reference.networks import last_layer

SENSOR = jl.Sensor(oversampling=4)
TRIALS_RANGE = (1, 256)


@pytest.mark.parametrize("bits", [1, 2, 16, 100, 256])
@pytest.mark.parametrize("size", [(1, 1), (19, 30)])
def test_a_conditioned_network_equals_its_twin(bits, size):
    network, sensor = conditional_network(), jl.Sensor(frames=bits, max_intensity=5.0)
    counts = random_counts(sensor, *size)
    layers = deep.conditioned(network.layers, bits, TRIALS_RANGE, count_sets(network.layers))
    # The network holds its filters in float32.
    sums = counts[None] * np.float64(layers[0].filters.reshape(()))
    expected = deep.output(layers, sums, size_divisor(layers))
    conditioned = jl.Network(network.conditioned_layers(bits), sensor)
    probabilities = last_layer(conditioned, counts)
    np.testing.assert_allclose(probabilities, expected, atol=1e-5)
    light = (-np.log1p(-expected.clip(0, 1 - 1e-9))).clip(0, 5)
    near = expected < 0.95
    np.testing.assert_allclose(
        network.reconstruct(counts, sensor)[near], light[near], atol=3e-4, rtol=1e-3
    )


@pytest.mark.parametrize("number", [4, 5, 6, 9])
def test_conditioning_weights_are_values_of_b_splines(number):
    for bits in (1, 1.5, 2, 16, 99, 255.9, 256):
        found = conditioning_weights(bits, TRIALS_RANGE, number)
        assert found.min() >= 0
        assert abs(found.sum() - 1) < 1e-12
        np.testing.assert_allclose(
            found, deep.conditioning_weights(bits, TRIALS_RANGE, number), atol=1e-10
        )


def test_equal_parameter_sets_give_the_same_layer_for_every_k():
    network = jl.Network.conditional("small", rng=0)
    layer = network.layers[5]
    assert layer.set_counts
    for bits in (1, 7, 256):
        at = network.conditioned_layers(bits)[5]
        np.testing.assert_allclose(at.coefficients, layer.coefficients[0], atol=1e-6)


@pytest.mark.parametrize("bits", [1, 16, 99, 256])
def test_conditioned_layers_are_weighted_sums_of_the_sets(bits):
    network = conditional_network()
    sets = count_sets(network.layers)
    expected = deep.conditioned(network.layers, bits, TRIALS_RANGE, sets)
    found = network.conditioned_layers(bits)
    for one, other in zip(found, expected, strict=True):
        assert one.metadata() == other.metadata()
        np.testing.assert_allclose(one.filters, other.filters, atol=1e-6)
        if one.coefficients is not None:
            np.testing.assert_allclose(one.coefficients, other.coefficients, atol=1e-6)
    zeros = network.conditioned_layers(bits, zeros=True)[-1].coefficients
    np.testing.assert_allclose(zeros, 1 - expected[-1].coefficients, atol=1e-6)


def test_all_layers_need_the_same_number_of_sets_and_at_least_four():
    layers = list(conditional_network().layers)
    for kept in (3, 5):
        cut = dataclasses.replace(layers[1], filters=layers[1].filters[:kept])
        with pytest.raises(ValueError, match="the same number of parameter sets"):
            jl.Network([layers[0], cut, *layers[2:]], jl.Sensor(), trials_range=TRIALS_RANGE)


def test_a_k_below_the_range_is_refused():
    network = jl.Network.conditional("small", trials_range=(4, 32), rng=0)
    with pytest.raises(ValueError, match="for 4 trials per pixel or more, got 3"):
        network.reconstruct(np.ones((4, 4), int), jl.Sensor(frames=3))


def test_a_conditional_network_serves_different_k_in_turn():
    network = jl.Network.conditional("small", trials_range=(2, 32), rng=0)
    counts = np.random.default_rng(7).integers(0, 3, (20, 30))
    four, nine = jl.Sensor(frames=4), jl.Sensor(frames=9)
    first, other = network.reconstruct(counts, four), network.reconstruct(counts, nine)
    assert (first != other).any()
    np.testing.assert_array_equal(network.reconstruct(counts, four), first)


@pytest.mark.parametrize("trials", [1, 257, np.nan])
def test_parameters_for_a_k_out_of_range_are_refused(trials):
    with pytest.raises(ValueError, match="trials: expected 2 to 256, the K that"):
        conditioning_weights(trials, (2, 256), 5)
