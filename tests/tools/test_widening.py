"""Networks whose channels and layers are extended: they compute the same at first."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.pretrained import FOLDER

PATH = Path(__file__).parents[2] / "tools/widening.py"
SPEC = importlib.util.spec_from_file_location("widening", PATH)
widening = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(widening)


@pytest.mark.slow
def test_a_wider_network_has_the_estimates_of_the_smaller_one():
    medium = jl.Network.load(FOLDER / "medium.safetensors")
    large = widening.widen(medium, "medium", "large")
    assert [layer.channels for layer in large.layers] == [
        layer.channels for layer in jl.Network.conditional("large", rng=0).layers
    ]
    assert large.history["stages"] == [*medium.history["stages"], "widened from medium to large"]
    image = jl.datasets.photograph("camera")[100:164, 180:244]
    for trials in (1, 16, 256):
        sensor = jl.Sensor(frames=trials)
        counts = sensor.expose(image, rng=0).counts()
        expected = medium.reconstruct(counts, sensor)
        np.testing.assert_allclose(large.reconstruct(counts, sensor), expected, atol=2e-5)


@pytest.mark.slow
def test_new_channels_and_layers_depend_on_the_seed_only():
    medium = jl.Network.load(FOLDER / "medium.safetensors")
    first, same, other = (
        widening.widen(medium, "medium", "large", seed=seed).layers[4].filters for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, same)
    assert (first != other).any()


def test_architectures_of_other_depths_are_refused():
    medium = jl.Network.load(FOLDER / "medium.safetensors")
    with pytest.raises(ValueError, match="target: expected the resolutions of medium, got small"):
        widening.widen(medium, "medium", "small")
