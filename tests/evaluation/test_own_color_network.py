"""Color networks of the caller as methods."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.pretrained import CHANNELS_FILE, MOSAIC_FILE, pretrained_color

DIFFERENCES = {"demosaicing": "differences"}
SCENE = jl.datasets.photograph("astronaut")[:128:4, 100:228:4].astype(np.float64)


def draw(mosaic, **parameters):
    sensor = jl.Sensor(frames=8, mosaic=mosaic, **parameters)
    return sensor.expose(SCENE, rng=0, channel_axis=None if mosaic else -1)


@pytest.mark.parametrize(("mosaic", "file"), [("RGGB", MOSAIC_FILE), (None, CHANNELS_FILE)])
def test_the_pretrained_network_as_a_method_has_the_default_result(mosaic, file):
    bits, out = draw(mosaic), np.empty(SCENE.shape, np.float32)
    network = pretrained_color(file)
    found, info = jl.reconstruct(bits, method=network, out=out, return_info=True)
    assert found is out
    np.testing.assert_array_equal(found, jl.reconstruct(bits))
    assert (info.method, info.title, info.reason) == ("network", "network, own", "requested")


def test_an_untrained_network_returns_its_start():
    bits = draw("RGGB")
    network = jl.ColorNetwork.initial("small", rng=0)
    found = jl.reconstruct(bits, method=network, units="photons")
    expected = jl.reconstruct(bits, quality="large", units="photons", **DIFFERENCES)
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.05 * np.sqrt(np.mean(expected**2))


@pytest.mark.parametrize("mosaic", ["RGGB", None])
@pytest.mark.parametrize(
    "extra", [{"quality": "small"}, {"fallback": True}, {"weight": 0.1}], ids=str
)
def test_a_network_has_no_further_options(mosaic, extra):
    with pytest.raises(ValueError, match=f"{next(iter(extra))}: is not an option of a network"):
        jl.reconstruct(draw(mosaic), method=jl.ColorNetwork.initial("small", rng=0), **extra)


def test_data_that_a_color_network_does_not_take_are_refused():
    network = jl.ColorNetwork.initial("small", rng=0)
    gray = jl.Sensor(frames=8).expose(SCENE[..., 0], rng=0)
    counts, sensor = draw("RGGB").counts(), draw("RGGB").sensor
    several = counts[..., None].repeat(3, axis=-1)
    for data, own, options in (
        (gray, None, {}),
        (draw(None, kernel="cubic"), None, {}),
        (counts, sensor, {"trials": np.full(counts.shape, 8)}),
        (several, jl.Sensor(frames=5000, kernel="cubic"), {"channel_axis": -1}),
    ):
        with pytest.raises(ValueError, match="method: a color network takes bits of a sensor"):
            jl.reconstruct(data, own, method=network, **options)
    with pytest.raises(ValueError, match="demosaicing: is not an option of a color network"):
        jl.reconstruct(draw("RGGB"), method=network, **DIFFERENCES)
