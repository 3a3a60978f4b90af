"""Color networks: their start, their files, and their errors."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.planes.color_planes import Filtered, color_planes
from jotlight.networks.planes_network import ColorNetwork
from jotlight.networks.pretrained import MOSAIC_FILE


def planes_and_start(shape):
    """Return planes, and the classical colors in them."""
    rng = np.random.default_rng(0)
    fractions, start = rng.integers(0, 17, (3, *shape)) / 16, rng.random((3, *shape))
    every = np.ones(shape)
    seen = [Filtered(share, each, every) for share, each in zip(np.eye(3), fractions, strict=True)]
    return color_planes(seen, start, lambda intensity: np.clip(intensity, 0, 1)), start


@pytest.mark.parametrize("size", ["small", "medium", "large"])
@pytest.mark.parametrize("shape", [(16, 24), (9, 7)])
def test_an_untrained_network_returns_the_classical_colors(size, shape):
    network = ColorNetwork.initial(size, rng=0)
    planes, start = planes_and_start(shape)
    found = network.estimate_probability(planes, 16)
    np.testing.assert_allclose(found, start, atol=1e-5)


def test_the_output_is_the_mean_over_rotations():
    network = ColorNetwork.load(MOSAIC_FILE)
    planes, _ = planes_and_start((16, 24))
    each = []
    for turns in range(4):
        turned = np.ascontiguousarray(np.rot90(planes, turns, (1, 2)))
        each.append(np.rot90(network.estimate_probability(turned, 9), -turns, (1, 2)))
    turned = ColorNetwork(network.layers, trials_range=network.trials_range, rotations=4)
    found = turned.estimate_probability(planes, 9)
    np.testing.assert_allclose(found, np.mean(each, axis=0), atol=1e-6)
    assert np.abs(found - each[0]).max() > 1e-4


@pytest.mark.parametrize("rotations", [1, 4])
def test_files_keep_a_network(tmp_path, rotations):
    layers = ColorNetwork.load(MOSAIC_FILE).layers
    network = ColorNetwork(layers, trials_range=(2, 32), rotations=rotations)
    network.save(tmp_path / "c.safetensors")
    loaded = ColorNetwork.load(tmp_path / "c.safetensors")
    assert (loaded.trials_range, loaded.rotations) == ((2, 32), rotations)
    for layer, other in zip(network.layers, loaded.layers, strict=True):
        np.testing.assert_array_equal(layer.filters, other.filters)
    found, expected = (
        each.estimate_probability(planes_and_start((8, 8))[0], 1000)  # the nearest K is used
        for each in (loaded, network)
    )
    np.testing.assert_array_equal(found, expected)
    with pytest.raises(ValueError, match=r"got a color network, .*ColorNetwork\.load reads"):
        jl.Network.load(tmp_path / "c.safetensors")


def test_other_layers_and_kernels_are_refused(tmp_path):
    gray = jl.Network.conditional("small", rng=0)
    gray.save(tmp_path / "gray.safetensors")
    with pytest.raises(ValueError, match=r"expected a color network, .*Network\.load reads"):
        ColorNetwork.load(tmp_path / "gray.safetensors")
    with pytest.raises(ValueError, match="expected 11 channels of the first layer and 3"):
        ColorNetwork(gray.layers, trials_range=(1, 4))
    with pytest.raises(ValueError, match="layers: expected at least one"):
        ColorNetwork([], trials_range=(1, 4))
    with pytest.raises(ValueError, match="rotations: expected 1 or 4, got 2"):
        ColorNetwork(ColorNetwork.initial("small").layers, trials_range=(1, 4), rotations=2)
    with pytest.raises(ValueError, match="expected the box kernel, got cubic"):
        ColorNetwork.initial("small", rng=0).check_sensor(jl.Sensor(kernel="cubic"))
