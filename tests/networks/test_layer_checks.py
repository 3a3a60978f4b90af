"""Which layers fit a sensor, a range of K, and rotations."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from reference.networks import random_network

SENSOR = jl.Sensor(frames=16)
CONDITIONAL = jl.Network.conditional("small", rng=0)
ONE_K = jl.pretrained(SENSOR, "small")
RANGE = "trials_range: expected the smallest and the largest K of a tied network, got "


def untied():
    return random_network(
        np.random.default_rng(0), jl.Sensor(frames=3), [1, 1], [(1, 1), (3, 3)], tied=False
    )


@pytest.mark.parametrize(
    ("trials_range", "message"),
    [
        (None, "trials_range: expected a range of K for layers with sets"),
        ((0, 16), RANGE),
        ((16, 16), RANGE),
        (3, RANGE + "3"),
        ("ab", RANGE + "'ab'"),
        ((1.5, 9), RANGE + r"\(1.5, 9\)"),
    ],
)
def test_parameter_sets_need_a_range_of_k(trials_range, message):
    with pytest.raises(ValueError, match=message):
        jl.Network(CONDITIONAL.layers, jl.Sensor(), trials_range=trials_range)


def test_untied_layers_serve_their_sensor_alone():
    network = untied()
    with pytest.raises(ValueError, match=r"layers: expected filters of shape \(C, 5, 1, 1\) in"):
        jl.Network(network.layers, jl.Sensor(frames=5))
    with pytest.raises(ValueError, match="rotations: expected 1 for a network that is not tied"):
        jl.Network(network.layers, network.sensor, rotations=4)


def test_the_last_layer_has_one_channel():
    first, last = jl.Network.initial(SENSOR).layers
    filters, coefficients = (each.repeat(3, axis=0) for each in (last.filters, last.coefficients))
    wide = dataclasses.replace(last, filters=filters, coefficients=coefficients)
    with pytest.raises(ValueError, match=r"layers: expected one output channel .* got 3"):
        jl.Network([first, wide], SENSOR)
    with pytest.raises(ValueError, match="layers: expected at least one, got none"):
        jl.Network([], SENSOR)


@pytest.mark.parametrize("rotations", [0, 2, None, "4"])
def test_rotations_are_one_or_four(rotations):
    with pytest.raises(ValueError, match=f"rotations: expected 1 or 4, got {rotations!r}"):
        jl.Network(ONE_K.layers, SENSOR, rotations=rotations)


@pytest.mark.parametrize("layers", [SENSOR, "small", [1, 2], None])
def test_a_network_is_made_of_layers(layers):
    with pytest.raises(TypeError, match=r"Network: expected a sequence of jotlight\.Layer, and"):
        jl.Network(layers, SENSOR)
