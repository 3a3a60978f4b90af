"""The graph of layers: connections, size divisor, and halo."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.graph import size_divisor
from reference import deep
from reference.deep import random_counts

SENSOR = jl.Sensor(oversampling=4)
ARCHITECTURES = ("small", "medium")


def layer(outputs, inputs, taps=3, *, splines=False, **options):
    coefficients = np.zeros((outputs // options.get("upsampling", 1) ** 2, 4)) if splines else None
    return jl.Layer(np.ones((outputs, inputs, taps, taps)), coefficients, **options)


FIRST = layer(2, 1, 1)
LAST = layer(1, 2)


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ([layer(1, 1, 1, input=0)], "the first one to read the data"),
        ([layer(1, 1, 1, skip=0)], "the first one to read the data"),
        ([layer(4, 1, 1, upsampling=2)], "the first one to read the data"),
        ([FIRST, layer(1, 2, input=1)], "input of layer 1 to be 0 to 0, got 1"),
        ([FIRST, layer(1, 2, skip=-1)], "skip of layer 1 to be 0 to 0, got -1"),
        ([FIRST, layer(3, 2), layer(1, 2)], "expected 3 input channels in layer 2"),
        (
            [FIRST, layer(3, 2), layer(1, 3, skip=1)],
            "the skip connection of layer 2 to have its 1 channels",
        ),
        (
            [FIRST, layer(2, 2, stride=2), layer(2, 2, skip=0), LAST],
            "layer 2 to have its 2 channels and its size, got the output of layer 0",
        ),
        ([FIRST, layer(2, 2)], "one output channel of the last layer"),
        ([FIRST, layer(1, 2, stride=2)], "outputs of the last layer in the size of the estimate"),
        (
            [FIRST, layer(4, 2, upsampling=2)],
            "outputs of the last layer in the size of the estimate",
        ),
        (
            [FIRST, layer(3, 2), layer(1, 2, input=0)],
            "another layer to use the output of layer 1, got none",
        ),
    ],
)
def test_layers_that_cannot_be_connected_are_refused(layers, message):
    with pytest.raises(ValueError, match=message):
        jl.Network(layers, SENSOR).reconstruct(np.ones((4, 4), int))


def test_strides_of_more_than_256_together_are_refused():
    one = np.ones((1, 1, 1, 1), np.float32)
    down, up = np.ones((1, 1, 16, 16), np.float32), np.ones((256, 1, 1, 1), np.float32)
    layers = [jl.Layer(one, None), *[jl.Layer(down, None, stride=16)] * 3]
    layers += [jl.Layer(up, None, upsampling=16)] * 3
    with pytest.raises(ValueError, match="at most 256 together, got 4096"):
        jl.Network(layers, SENSOR)


def test_the_halo_is_as_narrow_as_possible():
    """Pixels outside the halo have no effect. A pixel just inside has one."""
    network = deep.random_graph(np.random.default_rng(3), SENSOR)
    halo, step = network.halo, size_divisor(network.layers)
    size = 4 * halo // step * step
    counts = random_counts(SENSOR, size, size)
    one = network.reconstruct(counts)
    middle = size // 2 // step * step
    changed = np.zeros((size, size), bool)
    for pixel in range(middle, middle + step):
        other = counts.copy()
        other[pixel, middle] = (other[pixel, middle] + 8) % 17
        changed |= network.reconstruct(other) != one
    rows, columns = np.nonzero(changed)
    reach = max(middle - rows.min(), rows.max() - (middle + step - 1))
    reach = max(reach, middle - columns.min(), columns.max() - (middle + step - 1))
    assert halo - 2 * step < reach <= halo


def test_the_halo_is_a_multiple_of_the_size_divisor():
    for name in ARCHITECTURES:
        network = jl.Network.residual(SENSOR, name, rng=0)
        assert network.halo % size_divisor(network.layers) == 0
