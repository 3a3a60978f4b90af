"""Arguments of the uncertainty that do not belong together, as those of reconstructions."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.pretrained import MOSAIC_FILE, pretrained_color

GRAY = jl.Sensor(frames=16)
MOSAIC = jl.Sensor(frames=16, mosaic="RGGB")
COUNTS = np.full((8, 8), 5)


def ones(counts):
    return np.ones(counts.shape, np.float32)


@pytest.mark.parametrize("sensor", [GRAY, MOSAIC], ids=["gray", "mosaic"])
@pytest.mark.parametrize("is_known", [False, True], ids=["computed", "known"])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "mle", "quality": "small"}, "quality: selects a pretrained network, but"),
        ({"method": "network-medium", "quality": "large"}, "quality: selects a pretrained"),
        ({"method": ones, "quality": "small"}, "quality: selects a pretrained network, but"),
        ({"quality": "tiny"}, "quality: expected one of"),
        ({"method": "magic"}, "method: there is no 'magic'"),
        ({"method": "mle", "fallback": True}, "fallback: is for networks, but the method is mle"),
        ({"method": ones, "fallback": True}, "fallback: is for networks, but method is"),
        ({"method": "admm-tv", "precision": "bf16"}, "precision: expected f32 for admm-tv"),
        ({"method": ones, "precision": "bf16"}, "precision: expected f32 for a function"),
    ],
)
def test_contradictions_are_refused_as_by_reconstructions(sensor, is_known, options, message):
    shape = (8, 8) if sensor is GRAY else (8, 8, 3)
    known = {"estimate": np.full(shape, 0.4)} if is_known else {}
    with pytest.raises(ValueError, match=message):
        jl.uncertainty(COUNTS, sensor, **known, **options)
    with pytest.raises(ValueError, match=message):
        jl.reconstruct(COUNTS, sensor, **options)


@pytest.mark.parametrize("method", ["mle", "network-color", pretrained_color(MOSAIC_FILE)], ids=str)
def test_demosaicing_that_does_not_go_with_a_method_is_refused(method):
    demosaicing = "network" if method == "mle" else "differences"
    for function in (jl.reconstruct, jl.uncertainty):
        with pytest.raises(ValueError, match="demosaicing: "):
            function(COUNTS, MOSAIC, method=method, demosaicing=demosaicing)


@pytest.mark.slow
def test_a_color_network_of_the_caller_may_name_its_demosaicing():
    own = {"method": pretrained_color(MOSAIC_FILE)}
    known, expected = (
        jl.uncertainty(COUNTS, MOSAIC, **own, demosaicing=each) for each in ("network", None)
    )
    np.testing.assert_array_equal(known.standard_error, expected.standard_error)


def test_the_color_network_needs_colors():
    with pytest.raises(ValueError, match=r"method: a color network takes .* got other data"):
        jl.uncertainty(COUNTS, GRAY, method="network-color", estimate=np.full((8, 8), 0.4))


@pytest.mark.slow
def test_a_module_of_torch_is_its_network():
    pytest.importorskip("torch")
    network = jl.pretrained(GRAY, "medium")
    module = jl.torch.Network(network)
    found, expected = (jl.uncertainty(COUNTS, GRAY, method=each) for each in (module, network))
    np.testing.assert_allclose(found.standard_error, expected.standard_error, rtol=1e-4)
