"""The forward pass of networks with strides, upsampling, and skip connections."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.graph import size_divisor
from reference import deep, networks
from reference.deep import random_counts, residual_network
from reference.networks import last_layer, random_bits

SENSOR = jl.Sensor(oversampling=4)
ARCHITECTURES = ("small", "medium")
SIZES = [(1, 1), (2, 3), (5, 1), (30, 47), (33, 64)]
ROUNDING = 1e-6


def twin(network, bits):
    sums = networks.block_sums(network.layers[0].filters, bits, network.sensor.oversampling)
    return deep.output(network.layers, sums, size_divisor(network.layers))


@pytest.mark.parametrize("name", ARCHITECTURES)
@pytest.mark.parametrize("size", SIZES)
def test_a_residual_network_equals_its_twin(name, size):
    network = residual_network(name)
    bits = random_bits(np.random.default_rng(1), SENSOR, *size)
    expected = twin(network, bits)
    estimate = last_layer(network, jl.Bits.from_array(bits))
    assert (estimate.shape, estimate.dtype) == (size, np.float32)
    np.testing.assert_allclose(estimate, expected, atol=1e-5)
    counts = bits.reshape(size[0], 4, size[1], 4).sum((1, 3))
    np.testing.assert_array_equal(last_layer(network, counts), estimate)


@pytest.mark.slow
def test_an_estimate_of_many_tiles_equals_the_twins():
    network, counts = residual_network("medium"), random_counts(SENSOR, 150, 1060)
    sums = network.layers[0].filters[:, 0] * counts[None]
    estimate = last_layer(network, counts, threads=1)
    np.testing.assert_allclose(estimate, deep.output(network.layers, sums, 4), atol=1e-5)
    np.testing.assert_array_equal(last_layer(network, counts, threads=3), estimate)


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize(
    "size", [(1, 1), (7, 5), pytest.param((24, 36), marks=pytest.mark.slow), (61, 50)]
)
@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2))])
def test_any_graph_equals_its_twin(tied, size, seed):
    rng = np.random.default_rng(seed)
    sensor = jl.Sensor(oversampling=3, frames=2)
    network = deep.random_graph(rng, sensor, tied=tied)
    assert (size_divisor(network.layers), network.halo % 6) == (6, 0)
    bits = random_bits(rng, sensor, *size)
    estimate = last_layer(network, jl.Bits.from_array(bits))
    np.testing.assert_allclose(estimate, twin(network, bits), atol=2e-5)


def test_filters_may_be_larger_than_a_multiple_of_the_stride():
    rng = np.random.default_rng(0)
    network = deep.random_graph(rng, SENSOR, odd=True)
    bits = random_bits(rng, SENSOR, 100, 70)
    estimate = last_layer(network, jl.Bits.from_array(bits))
    np.testing.assert_allclose(estimate, twin(network, bits), atol=2e-5)


@pytest.mark.parametrize(("stride", "upsampling", "step"), [(2, 2, 2), (4, 2, 4), (3, 3, 3)])
@pytest.mark.parametrize("size", [(5, 7), (13, 110), (61, 50)])
def test_one_layer_may_have_a_stride_and_an_upsampling(stride, upsampling, step, size):
    rng = np.random.default_rng(5)
    one = np.ones((1, 1, 1, 1), np.float32)
    both = rng.normal(0, 0.3, (2 * upsampling**2, 1, stride, stride)).astype(np.float32)
    back = rng.normal(0, 0.3, ((stride // upsampling) ** 2, 2, 1, 1)).astype(np.float32)
    layers = [
        jl.Layer(one / 16, None),
        jl.Layer(both, None, stride=stride, upsampling=upsampling),
        jl.Layer(back, None, upsampling=stride // upsampling),
    ]
    assert size_divisor(layers) == step
    network = jl.Network(layers, SENSOR)
    counts = random_counts(SENSOR, *size)
    estimate = last_layer(network, counts, threads=1)
    expected = deep.output(layers, counts[None] / 16, step)
    np.testing.assert_allclose(estimate, expected, atol=1e-5)
    np.testing.assert_array_equal(last_layer(network, counts, threads=3), estimate)


@pytest.mark.parametrize("times", [2, 3, 5])
def test_tiles_need_not_be_multiples_of_the_upsampling(times):
    rng = np.random.default_rng(8)
    one = np.ones((1, 1, 1, 1), np.float32)
    down = rng.normal(0, 0.3, (times**2, 1, times, times)).astype(np.float32)
    depth = np.eye(times**2, dtype=np.float32)[:, :, None, None]
    layers = [
        jl.Layer(one / 16, None),
        jl.Layer(down, None, stride=times),
        jl.Layer(depth, None, upsampling=times),
    ]
    counts = random_counts(SENSOR, 12, 2100)
    estimate = last_layer(jl.Network(layers, SENSOR), counts)
    np.testing.assert_allclose(estimate, deep.output(layers, counts[None] / 16, times), atol=1e-5)


def test_layers_with_too_many_values_per_pixel_are_refused():
    one = np.ones((1, 1, 1, 1), np.float32)
    up, down = np.ones((256, 1, 1, 1), np.float32), np.ones((1, 1, 16, 16), np.float32)
    many = np.ones((17, 1, 1, 1), np.float32)
    layers = [
        jl.Layer(one, None),
        *[jl.Layer(up, None, upsampling=16)] * 2,
        jl.Layer(many, None),
        jl.Layer(np.ones((1, 17, 16, 16), np.float32), None, stride=16),
        jl.Layer(down, None, stride=16),
    ]
    with pytest.raises(ValueError, match="values per pixel times the combined stride"):
        last_layer(jl.Network(layers, SENSOR), random_counts(SENSOR, 5, 5))
    # The maximum number of channels fits into a tile of a few rows.
    layers[3], layers[4] = jl.Layer(one, None), jl.Layer(down, None, stride=16)
    assert last_layer(jl.Network(layers, SENSOR), random_counts(SENSOR, 5, 5)).shape == (5, 5)


def test_an_untied_deep_network_leaves_out_dead_jots():
    rng = np.random.default_rng(4)
    sensor = jl.Sensor(oversampling=3)
    network = deep.random_graph(rng, sensor, tied=False)
    bits = random_bits(rng, sensor, 12, 18)
    dead = rng.random(bits.shape[1:]) < 0.4
    dead[1::3, 1::3] = False
    sums = networks.block_sums(network.layers[0].filters, bits, 3, dead)
    estimate = last_layer(network, jl.Bits.from_array(bits), sensor.replace(mask=dead))
    expected = deep.output(network.layers, sums, 6)
    np.testing.assert_allclose(estimate, expected, atol=2e-5)


@pytest.mark.parametrize("name", ARCHITECTURES)
@pytest.mark.parametrize("size", [(1, 7), (150, 300), (261, 130)])
def test_the_number_of_threads_changes_nothing(name, size):
    network, counts = residual_network(name), random_counts(SENSOR, *size)
    one = last_layer(network, counts, threads=1)
    for threads in (2, 7, None):
        np.testing.assert_array_equal(last_layer(network, counts, threads=threads), one)


RNG = np.random.default_rng(9)


@pytest.mark.parametrize(
    "make", [lambda: residual_network("small"), lambda: deep.random_graph(RNG, SENSOR)]
)
def test_a_tile_with_a_border_of_the_halo_equals_the_whole(make):
    network = make()
    halo, step = network.halo, size_divisor(network.layers)
    height, width = 4 * halo + 5 * step, 3 * halo + 7 * step
    counts = random_counts(SENSOR, height, width)
    whole = last_layer(network, counts)
    tops = [0, step, height // 2 // step * step]
    for top, left in zip(tops, reversed(tops), strict=True):
        bottom, right = top + 3 * step, left + 2 * step
        first, start = max(0, top - halo), max(0, left - halo)
        part = last_layer(network, counts[first : bottom + halo, start : right + halo])
        np.testing.assert_allclose(
            part[top - first : bottom - first, left - start : right - start],
            whole[top:bottom, left:right],
            atol=ROUNDING,
        )
