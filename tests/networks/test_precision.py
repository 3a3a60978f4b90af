"""Networks with products in bfloat16: values, threads, sizes, quality, and what has no bfloat16."""

import copy
import pickle

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.networks.graph import size_divisor
from jotlight.networks.pretrained import (
    CHANNELS_FILE,
    MOSAIC_FILE,
    pretrained_color,
    pretrained_film,
)
from reference import deep
from reference.deep import random_counts, residual_network

SENSOR = jl.Sensor(oversampling=4)
SIZES = [(1, 1), (2, 3), (5, 1), (30, 47), (33, 64)]
LARGEST, MEAN = 0.02, 1e-3
"""Largest and mean difference of outputs of order 1. Different orders of a sum round its last bit
differently, and bfloat16 then has another value, by up to 2⁻⁸."""


def output_of(network, counts, threads=None):
    """The output of the last layer."""
    counts = [counts.astype(np.float32)]
    return network.engine_network.run_counts(counts, SENSOR.trials, False, threads)[0]


def in_bfloat16(network, counts, threads=None):
    """The output of the last layer, in bfloat16."""
    return output_of(network.with_precision("bf16"), counts, threads)


def twins(network, counts):
    """The outputs of the twins with and without rounding."""
    sums = network.layers[0].filters[:, 0] * counts[None]
    divisor = size_divisor(network.layers)
    layers, rounded = deep.in_bfloat16(network.layers)
    return deep.output(layers, sums, divisor, rounded), deep.output(network.layers, sums, divisor)


def assert_near(found, expected):
    difference = abs(found - expected)
    assert difference.max() < LARGEST
    assert difference.mean() < MEAN


@pytest.mark.parametrize("size", [(30, 47), (65, 130)])
@pytest.mark.parametrize("channels", [2, 16])
def test_a_layer_in_bfloat16_equals_its_twin(channels, size):
    rng = np.random.default_rng(0)

    def layer(outputs, inputs, side, **options):
        taps = rng.normal(0, 1 / np.sqrt(inputs * side**2), (outputs, inputs, side, side))
        number = outputs // options.get("upsampling", 1) ** 2
        return jl.Layer(taps, rng.normal(0, 1, (number, 9)), -2.0, 0.6, **options)

    first = jl.Layer(np.full((1, 1, 1, 1), 1 / SENSOR.trials, np.float32), None)
    planes = layer(channels, 1, 2, stride=2)
    network = jl.Network([first, planes, layer(4, channels, 3, upsampling=2)], SENSOR)
    counts = random_counts(SENSOR, *size)
    found = in_bfloat16(network, counts)
    expected, plain = twins(network, counts)
    # Few planes lie so near to the middle of two numbers that their sums round differently.
    assert np.quantile(abs(found - expected), 0.95) < 1e-5
    assert np.median(abs(found - plain)) > 1e-4


@pytest.mark.parametrize(("name", "times"), [("small", 5), ("medium", 2)])
@pytest.mark.parametrize("size", SIZES)
def test_a_network_in_bfloat16_equals_its_twin(name, times, size):
    network, counts = residual_network(name), random_counts(SENSOR, *size)
    found = in_bfloat16(network, counts)
    expected, plain = twins(network, counts)
    assert_near(found, expected)
    if min(size) > 5:  # The twin without the rounding is much farther away.
        assert abs(found - plain).mean() > times * abs(found - expected).mean()


@pytest.mark.parametrize("name", ["small", "medium"])
@pytest.mark.parametrize("size", [(1, 1), (9, 530), (150, 70), (301, 83)])
def test_estimates_in_bfloat16_are_the_same_for_any_number_of_threads(name, size):
    network, counts = residual_network(name), random_counts(SENSOR, *size)
    first = in_bfloat16(network, counts, threads=1)
    for threads in (2, 5):
        np.testing.assert_array_equal(in_bfloat16(network, counts, threads=threads), first)


def test_estimates_of_parts_equal_those_of_the_whole():
    network, counts = residual_network("small"), random_counts(SENSOR, 200, 160)
    whole, part = (in_bfloat16(network, each) for each in (counts, counts[48:148, 32:132]))
    halo = 16
    inside = np.s_[halo:-halo, halo:-halo]
    np.testing.assert_array_equal(part[inside], whole[48:148, 32:132][inside])


def test_instruction_sets_agree_up_to_the_rounding():
    network = residual_network("medium")
    counts = random_counts(SENSOR, 61, 50)
    results = []
    for level in engine.cpu_levels():
        engine.choose_cpu_level(level)
        results.append(in_bfloat16(network, counts))
        engine.choose_cpu_level(None)
    for result in results:
        assert_near(result, results[0])


@pytest.mark.parametrize(
    "trials", [16, *(pytest.param(trials, marks=pytest.mark.slow) for trials in (1, 4, 64, 256))]
)
def test_bfloat16_loses_hardly_any_quality(trials):
    sensor = jl.Sensor(frames=trials)
    photograph = jl.datasets.photograph("camera")
    images = [photograph[row : row + 160, 100:340] for row in (0, 120, 240, 350)]
    losses = []
    for quality in ("small", "medium", "large"):
        network = jl.pretrained(sensor, quality)
        for seed, image in enumerate(images):
            bits = sensor.expose(image, rng=seed)
            f32, bf16 = (network.with_precision(name).reconstruct(bits) for name in ("f32", "bf16"))
            assert (f32 != bf16).any()
            losses.append(jl.metrics.psnr(f32, image) - jl.metrics.psnr(bf16, image))
    assert np.mean(losses) <= 0.002
    assert np.max(losses) <= 0.005


def test_f32_is_the_default_and_returns_the_same_as_before():
    sensor = jl.Sensor(frames=16)
    bits = sensor.expose(np.full((16, 24), 0.3), rng=0)
    network = jl.pretrained(sensor)
    expected = network.reconstruct(bits)
    assert network.precision == "f32"
    changed = network.with_precision("bf16")
    assert (changed.reconstruct(bits) != expected).any()
    np.testing.assert_array_equal(network.reconstruct(bits), expected)
    np.testing.assert_array_equal(changed.with_precision("f32").reconstruct(bits), expected)


@pytest.mark.parametrize("duplicate", [copy.copy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_keep_the_precision(duplicate):
    sensor = jl.Sensor(frames=16)
    bits = sensor.expose(np.full((16, 24), 0.3), rng=0)
    network = jl.pretrained(sensor, "small").with_precision("bf16")
    found = duplicate(network)
    assert found.precision == "bf16"
    np.testing.assert_array_equal(found.reconstruct(bits), network.reconstruct(bits))


@pytest.mark.parametrize(
    "network",
    [
        pretrained_color(MOSAIC_FILE),
        pretrained_color(CHANNELS_FILE),
        pretrained_film(),
    ],
)
def test_networks_of_planes_have_bfloat16(network):
    planes = np.random.default_rng(0).uniform(-0.3, 0.3, (network.planes, 40, 56))
    planes = planes.astype(np.float32)
    found = network.with_precision("bf16").estimate_probability(planes, 16)
    difference = abs(found - network.estimate_probability(planes, 16))
    assert 0 < difference.max() < LARGEST


def test_networks_without_filters_of_several_planes_have_no_bfloat16():
    for network in (jl.pretrained(jl.Sensor(frames=16), "two-layer"), jl.Network.initial(SENSOR)):
        with pytest.raises(ValueError, match=r"expected f32, because no layer .*, got bf16; .*"):
            network.with_precision("bf16")
        assert network.with_precision("f32").precision == "f32"


def test_an_assigned_precision_is_used():
    sensor = jl.Sensor(frames=16)
    bits = sensor.expose(np.full((24, 24), 0.4), rng=0)
    network = jl.pretrained(sensor, "small")
    expected = network.with_precision("bf16").reconstruct(bits)
    assert (network.reconstruct(bits) != expected).any()
    network.precision = "bf16"
    np.testing.assert_array_equal(network.reconstruct(bits), expected)


def test_unknown_precisions_are_refused():
    network = jl.pretrained(jl.Sensor(frames=16), "small")
    with pytest.raises(ValueError, match="precision: expected one of f32, bf16, got 'f16'"):
        network.with_precision("f16")
    with pytest.raises(ValueError, match="precision: expected f32 or bf16, got f16"):
        network.engine_network.with_precision("f16")
