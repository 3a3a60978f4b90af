"""Networks: data and sensors that they accept, copies, and files."""

import copy
import pickle

import numpy as np
import pytest

import jotlight as jl
from reference.deep import conditional_network, residual_network
from reference.networks import random_bits, random_network

SPACE = jl.Sensor(oversampling=4)
TIED, UNTIED = (jl.Network.initial(SPACE, tied=tied) for tied in (True, False))
BITS = jl.Bits.from_array(np.zeros((1, 8, 8), bool))


@pytest.mark.parametrize("frames", [1, 4, 16])
def test_a_tied_network_serves_frames_like_jots(frames):
    network = jl.Network.initial(jl.Sensor(oversampling=4))
    counts = np.random.default_rng(9).integers(0, 17, (6, 7))
    side = {1: 4, 4: 2, 16: 1}[frames]
    sensor = jl.Sensor(oversampling=side, frames=frames)
    expected = network.reconstruct(counts)
    np.testing.assert_array_equal(network.reconstruct(counts, sensor), expected)
    order = np.arange(16).reshape(frames, side, side)
    values = np.tile(order, (6, 7)) < counts.repeat(side, 0).repeat(side, 1)
    carried = jl.Bits.from_array(values, sensor)
    np.testing.assert_array_equal(network.reconstruct(carried), expected)
    np.testing.assert_array_equal(network.reconstruct(jl.Bits.from_array(values), sensor), expected)


@pytest.mark.parametrize("tied", [True, False])
def test_color_channels_do_not_mix(tied):
    sensor = jl.Sensor(oversampling=2)
    network = jl.Network.initial(sensor, tied=tied)
    bits = np.random.default_rng(10).random((1, 8, 10, 3)) < 0.5
    estimate = network.reconstruct(jl.Bits.from_array(bits))
    for channel in range(3):
        alone = network.reconstruct(jl.Bits.from_array(bits[..., channel]))
        np.testing.assert_array_equal(estimate[..., channel], alone)


def test_a_tied_network_corrects_dark_counts_other_than_its_own():
    rng = np.random.default_rng(11)
    frames = 40_000  # with fewer, neighbors would have a part in the counts
    network = jl.Network.initial(jl.Sensor(frames=frames), sigma=0.25)
    dark = rng.uniform(0, 1.5, (30, 30))
    counts = rng.binomial(frames, 1 - np.exp(-0.5 - dark))
    sensor = jl.Sensor(frames=frames, dark_counts=dark)
    estimate = network.reconstruct(counts, sensor)
    np.testing.assert_allclose(estimate, jl.mle(counts, sensor), atol=0.02)


@pytest.mark.parametrize("network", [TIED, UNTIED], ids=["tied", "untied"])
@pytest.mark.parametrize(
    "change",
    [
        {"frames": 2},
        {"oversampling": 2},
        {"threshold": 2},
        {"gain": 8.0},
        {"efficiency": 0.5},
        {"max_intensity": 2.0},
    ],
    ids=str,
)
def test_a_sensor_with_another_response_to_light_is_refused(network, change):
    with pytest.raises(ValueError, match=r"sensor: the network (needs data with its own|is for)"):
        network.reconstruct(BITS, SPACE.replace(**change))


@pytest.mark.parametrize(
    ("network", "data", "sensor", "error", "message"),
    [
        (UNTIED, np.zeros((2, 2), int), None, TypeError, "a tied network takes counts"),
        (UNTIED, BITS, jl.Sensor(frames=16), ValueError, "1 frame of 4 x 4 .* 16 frames of 1 x 1"),
        (UNTIED, BITS, SPACE.replace(dark_counts=0.1), ValueError, "a tied network takes others"),
        (
            UNTIED,
            BITS,
            SPACE.replace(dark_counts=np.eye(8)),
            ValueError,
            "a tied network takes others",
        ),
        (TIED, [[17]], None, ValueError, "expected 0 to K = 16"),
        (TIED, [[0.5]], None, TypeError, "whole numbers"),
        (TIED, BITS, SPACE.replace(mask=np.zeros((4, 4), bool)), ValueError, "mask"),
        (UNTIED, BITS, SPACE.replace(mask=np.zeros((4, 4), bool)), ValueError, "mask"),
    ],
)
def test_data_that_do_not_fit_are_refused(network, data, sensor, error, message):
    with pytest.raises(error, match=message):
        network.reconstruct(data, sensor)


@pytest.mark.parametrize(
    ("filters", "message"),
    [
        ([], "at least one, got none"),
        ([(1, 2, 4, 4)], r"shape \(C, 1, 4, 4\) in the first layer, or \(C, 1, 1, 1\)"),
        ([(1, 1, 4, 3)], r"shape \(C, 1, 4, 4\)"),
        ([(2, 1, 1, 1), (1, 1, 3, 3)], "expected 2 input channels in layer 1"),
        ([(1, 1, 1, 1), (2, 1, 3, 3)], "one output channel of the last layer.*got 2"),
    ],
)
def test_layers_that_do_not_fit_each_other_or_the_sensor_are_refused(filters, message):
    layers = [jl.Layer(np.ones(shape), np.ones((shape[0], 5)), 0, 1) for shape in filters]
    with pytest.raises(ValueError, match=message):
        jl.Network(layers, SPACE)


def test_repr_states_channels_and_parameters():
    text = repr(
        random_network(np.random.default_rng(14), SPACE, [2, 3, 1], [(3, 3)] * 2, tied=True)
    )
    assert text.startswith("<Network: channels 2 -> 3 -> 1, ")
    assert f"{2 + 22 + 54 + 33 + 27 + 11} parameters" in text


def test_a_network_for_another_kernel_is_refused():
    with pytest.raises(ValueError, match="for the box kernel, got cubic"):
        TIED.reconstruct(BITS, SPACE.replace(kernel="cubic"))


def pickled(network):
    return pickle.loads(pickle.dumps(network))


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, pickled])
def test_a_network_that_has_run_is_copied_and_pickled(again):
    rng = np.random.default_rng(6)
    sensor = jl.Sensor(oversampling=2, frames=3)
    network = random_network(rng, sensor, [2, 1], [(3, 3)], tied=False)
    bits = jl.Bits.from_array(random_bits(rng, sensor, 20, 30))
    expected = network.reconstruct(bits)
    copied = again(network)
    np.testing.assert_array_equal(copied.reconstruct(bits), expected)
    assert not copied.layers[0].filters.flags.writeable


SENSOR = jl.Sensor(oversampling=4)
ARCHITECTURES = ("small", "medium")


@pytest.mark.parametrize(
    "make", [*(lambda n=n: residual_network(n) for n in ARCHITECTURES), conditional_network]
)
def test_a_file_holds_every_field_of_a_deep_network(tmp_path, make):
    network = make()
    network.save(tmp_path / "deep.safetensors")
    loaded = jl.Network.load(tmp_path / "deep.safetensors")
    assert (loaded.sensor, loaded.trials_range) == (network.sensor, network.trials_range)
    for one, other in zip(network.layers, loaded.layers, strict=True):
        assert one.metadata() == other.metadata()
        np.testing.assert_array_equal(one.filters, other.filters)
        assert (one.coefficients is None) == (other.coefficients is None)
        if one.coefficients is not None:
            np.testing.assert_array_equal(one.coefficients, other.coefficients)
