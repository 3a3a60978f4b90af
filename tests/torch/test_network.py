"""The networks as modules of PyTorch."""

import copy
import pickle

import numpy as np
import pytest

import jotlight as jl
from reference import deep
from reference.networks import random_bits, random_network

torch = pytest.importorskip("torch")
from jotlight.torch import NetworkModule  # noqa: E402

SENSOR = jl.Sensor(oversampling=4)
SIZES = [(1, 1), (2, 5), (33, 47), (64, 40)]


def member(name):
    return deep.with_noise(jl.Network.residual(SENSOR, name, rng=0), np.random.default_rng(0))


def conditional(name):
    return deep.with_noise(jl.Network.conditional(name, rng=0), np.random.default_rng(1))


def build_two_layer(*, tied):
    rng = np.random.default_rng(2)
    return random_network(rng, jl.Sensor(oversampling=3, frames=2), [2, 1], [(5, 4)], tied=tied)


NETWORKS = {
    "initial": lambda: jl.Network.initial(SENSOR),
    "two layers": lambda: build_two_layer(tied=True),
    "two layers, jots": lambda: build_two_layer(tied=False),
    "small": lambda: member("small"),
    "medium": lambda: member("medium"),
    "wired": lambda: deep.random_graph(np.random.default_rng(3), SENSOR),
    "wired, jots": lambda: deep.random_graph(np.random.default_rng(3), SENSOR, tied=False),
}
CONDITIONAL = {"small": lambda: conditional("small"), "medium": lambda: conditional("medium")}
every_network = pytest.mark.parametrize(
    "make",
    [*NETWORKS.values(), *CONDITIONAL.values()],
    ids=[*NETWORKS, *(f"conditional {x}" for x in CONDITIONAL)],
)


def seen(network, size):
    """Bits, and what the module takes."""
    sensor = network.sensor
    bits = random_bits(np.random.default_rng(4), sensor, *size)
    if not network.tied:
        return jl.Bits.from_array(bits), torch.from_numpy(bits.astype(np.float32))[None]
    side = sensor.oversampling
    counts = jl.Bits.from_array(bits).counts(side)
    return counts, torch.from_numpy(counts.astype(np.float32))[None, None]


def picture(module, data):
    bits = 16 if module.origin.trials_range else None
    with torch.no_grad():
        return module(data, bits)


@pytest.mark.parametrize("make", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("size", SIZES)
def test_the_module_gives_the_engines_picture(make, size):
    network = make()
    data, tensor = seen(network, size)
    given = picture(NetworkModule(network), tensor)
    assert given.shape == (1, 1, *size)
    np.testing.assert_allclose(given[0, 0], network.reconstruct(data), atol=1e-5)


@pytest.mark.parametrize("make", CONDITIONAL.values(), ids=CONDITIONAL)
@pytest.mark.parametrize("bits", [1, 16, 256])
@pytest.mark.parametrize("size", SIZES)
def test_a_module_that_is_told_k_gives_the_engines_shares(make, bits, size):
    network, sensor = make(), jl.Sensor(frames=bits)
    counts = np.random.default_rng(5).integers(0, bits + 1, (2, *size))
    with torch.no_grad():
        given = NetworkModule(network)(torch.from_numpy(counts).float()[:, None], bits)
    for one, shares in zip(counts, given[:, 0], strict=True):
        np.testing.assert_allclose(
            shares, network.conditioned_on(sensor).reconstruct(one), atol=1e-5
        )


def test_a_module_is_told_k_if_and_only_if_it_has_to_be():
    data = torch.zeros(1, 1, 4, 4)
    for network, bits in ((conditional("small"), None), (member("small"), 16)):
        with pytest.raises(ValueError, match="trials: expected K for a K-conditioned network"):
            NetworkModule(network)(data, bits)


@every_network
def test_a_network_comes_back_as_it_was(tmp_path, make):
    start = make()
    network = NetworkModule(start).to_network()
    paths = tmp_path / "start.safetensors", tmp_path / "back.safetensors"
    start.save(paths[0])
    network.save(paths[1])
    assert paths[0].read_bytes() == paths[1].read_bytes()
    again = NetworkModule(jl.Network.load(paths[1]))
    for one, other in zip(NetworkModule(start).parameters(), again.parameters(), strict=True):
        assert torch.equal(one, other)
        assert one.requires_grad == other.requires_grad


@every_network
def test_state_copies_and_pickles_are_the_same_module(make):
    module = NetworkModule(make())
    _, tensor = seen(module.origin, (9, 14))
    expected = picture(module, tensor)
    other = NetworkModule(make())
    with torch.no_grad():
        for parameter in other.parameters():
            parameter.zero_()
    other.load_state_dict(module.state_dict())
    copies = other, copy.deepcopy(module), pickle.loads(pickle.dumps(module))
    for copied in copies:
        assert torch.equal(picture(copied, tensor), expected)
    with torch.no_grad():
        module.filters[-1].zero_()
    assert not torch.equal(picture(module, tensor), expected)
    assert torch.equal(picture(copies[1], tensor), expected)


@pytest.mark.parametrize("name", ["initial", "two layers, jots", "small", "wired"])
def test_gradients_are_those_of_differences(name):
    module = NetworkModule(NETWORKS[name]()).double()
    _, tensor = seen(module.origin, (5, 6))
    wanted = [parameter for parameter in module.parameters() if parameter.requires_grad]

    def values(*parameters):
        names = [n for n, p in module.named_parameters() if p.requires_grad]
        given = dict(zip(names, parameters, strict=True))
        return torch.func.functional_call(module, given, (tensor.double(),))

    # Not at the knots, where differences of counts that are whole may see two pieces.
    assert torch.autograd.gradcheck(values, wanted, fast_mode=True, atol=1e-4)


@pytest.mark.parametrize("name", ["initial", "small"])
def test_half_the_digits_give_nearly_the_same(name):
    module = NetworkModule(NETWORKS[name]())
    _, tensor = seen(module.origin, (20, 24))
    expected = picture(module, tensor)
    with torch.autocast("cpu", torch.bfloat16):
        near = picture(module, tensor)
    assert abs(near.float() - expected).mean() < 0.03
    assert torch.isfinite(near).all()
    with torch.autocast("cpu", torch.bfloat16):
        module(tensor).float().square().mean().backward()
    for parameter in module.parameters():
        if parameter.requires_grad:
            assert torch.isfinite(parameter.grad).all()


def test_compiling_changes_nothing():
    """Traced as one graph, and run as it was traced: without a compiler of C++."""
    module = NetworkModule(conditional("small"))
    torch._dynamo.reset()
    compiled = torch.compile(module, fullgraph=True, backend="aot_eager")
    _, tensor = seen(module.origin, (11, 20))
    given, expected = compiled(tensor, 16), module(tensor, 16)
    torch.testing.assert_close(given, expected, atol=1e-5, rtol=0)
    slopes = [
        torch.autograd.grad(x.square().sum(), module.coefficients["4"]) for x in (given, expected)
    ]
    torch.testing.assert_close(*slopes, atol=1e-4, rtol=1e-4)
    with torch.inference_mode():
        torch.testing.assert_close(compiled(tensor, 16), expected.detach(), atol=1e-5, rtol=0)


def test_what_is_known_exactly_does_not_learn():
    module = NetworkModule(jl.Network.residual(SENSOR, "small", rng=0))
    for layer, filters in zip(module.origin.layers, module.filters, strict=True):
        assert filters.requires_grad == (layer.trainable != "nothing")
    for index, coefficients in module.coefficients.items():
        learns = module.origin.layers[int(index)].trainable
        assert coefficients.requires_grad == (learns == "all")


def test_what_is_learned_further_does_not_change_a_network_that_was_given():
    module = NetworkModule(jl.Network.residual(jl.Sensor(frames=4), "small", rng=0))
    given = module.to_network()
    before = given.layers[2].filters.copy()
    with torch.no_grad():
        module.filters[2].add_(1)
    np.testing.assert_array_equal(given.layers[2].filters, before)
