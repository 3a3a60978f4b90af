"""Networks as PyTorch modules."""

import copy
import pickle

import numpy as np
import pytest

import jotlight as jl
from reference import deep
from reference.networks import last_layer, random_bits, random_network

torch = pytest.importorskip("torch")
from jotlight.torch import NetworkModule  # noqa: E402

SENSOR = jl.Sensor(oversampling=4)
SIZES = [(1, 1), (2, 5), (33, 47), (64, 40)]


def residual(name):
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
    "small": lambda: residual("small"),
    "medium": lambda: residual("medium"),
    "random graph": lambda: deep.random_graph(np.random.default_rng(3), SENSOR),
    "random graph, jots": lambda: deep.random_graph(np.random.default_rng(3), SENSOR, tied=False),
}
CONDITIONAL = {"small": lambda: conditional("small"), "medium": lambda: conditional("medium")}
every_network = pytest.mark.parametrize(
    "make",
    [*NETWORKS.values(), *CONDITIONAL.values()],
    ids=[*NETWORKS, *(f"conditional {x}" for x in CONDITIONAL)],
)


def random_data(network, size):
    """Return random bits or counts, and the same data as a tensor."""
    sensor = network.sensor
    bits = random_bits(np.random.default_rng(4), sensor, *size)
    if not network.tied:
        return jl.Bits.from_array(bits), torch.from_numpy(bits.astype(np.float32))[None]
    side = sensor.oversampling
    counts = jl.Bits.from_array(bits).counts(side)
    return counts, torch.from_numpy(counts.astype(np.float32))[None, None]


def estimate(module, data):
    trials = 16 if module.origin.trials_range else None
    with torch.no_grad():
        return module(data, trials)


@pytest.mark.parametrize("make", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("size", SIZES)
def test_the_module_returns_the_estimate_of_the_engine(make, size):
    network = make()
    data, tensor = random_data(network, size)
    actual = estimate(NetworkModule(network), tensor)
    assert actual.shape == (1, 1, *size)
    np.testing.assert_allclose(actual[0, 0], last_layer(network, data), atol=1e-5)


@pytest.mark.parametrize("make", CONDITIONAL.values(), ids=CONDITIONAL)
@pytest.mark.parametrize("trials", [1, 16, 256])
@pytest.mark.parametrize("size", SIZES)
def test_a_conditional_module_returns_the_probabilities_of_the_engine(make, trials, size):
    network, sensor = make(), jl.Sensor(frames=trials)
    counts = np.random.default_rng(5).integers(0, trials + 1, (2, *size))
    with torch.no_grad():
        actual = NetworkModule(network)(torch.from_numpy(counts).float()[:, None], trials)
    conditioned = jl.Network(network.conditioned_layers(trials), sensor)
    for image, probability in zip(counts, actual[:, 0], strict=True):
        np.testing.assert_allclose(probability, last_layer(conditioned, image), atol=1e-5)


def test_only_conditional_modules_take_the_number_of_trials():
    data = torch.zeros(1, 1, 4, 4)
    for network, trials in ((conditional("small"), None), (residual("small"), 16)):
        with pytest.raises(ValueError, match="trials: expected K for a K-conditioned network"):
            NetworkModule(network)(data, trials)


@every_network
def test_a_network_passes_through_the_module_unchanged(tmp_path, make):
    start = make()
    network = NetworkModule(start).to_network()
    paths = tmp_path / "start.safetensors", tmp_path / "again.safetensors"
    start.save(paths[0])
    network.save(paths[1])
    assert paths[0].read_bytes() == paths[1].read_bytes()
    again = NetworkModule(jl.Network.load(paths[1]))
    for before, after in zip(NetworkModule(start).parameters(), again.parameters(), strict=True):
        assert torch.equal(before, after)
        assert before.requires_grad == after.requires_grad


@every_network
def test_a_state_dict_a_copy_and_a_pickle_hold_the_whole_module(make):
    module = NetworkModule(make())
    _, tensor = random_data(module.origin, (9, 14))
    expected = estimate(module, tensor)
    other = NetworkModule(make())
    with torch.no_grad():
        for parameter in other.parameters():
            parameter.zero_()
    other.load_state_dict(module.state_dict())
    copies = other, copy.deepcopy(module), pickle.loads(pickle.dumps(module))
    for copied in copies:
        assert torch.equal(estimate(copied, tensor), expected)
    with torch.no_grad():
        module.filters[-1].zero_()
    assert not torch.equal(estimate(module, tensor), expected)
    assert torch.equal(estimate(copies[1], tensor), expected)


@pytest.mark.parametrize("name", ["initial", "two layers, jots", "small", "random graph"])
def test_gradients_agree_with_finite_differences(name):
    module = NetworkModule(NETWORKS[name]()).double()
    _, tensor = random_data(module.origin, (5, 6))
    trainable = [parameter for parameter in module.parameters() if parameter.requires_grad]

    def values(*parameters):
        names = [n for n, p in module.named_parameters() if p.requires_grad]
        named = dict(zip(names, parameters, strict=True))
        return torch.func.functional_call(module, named, (tensor.double(),))

    # Whole counts lie on knots, where a finite difference mixes two cubics; hence `atol`.
    assert torch.autograd.gradcheck(values, trainable, fast_mode=True, atol=1e-4)


@pytest.mark.parametrize("name", ["initial", "small"])
def test_autocast_to_bfloat16_changes_estimates_little_and_keeps_gradients_finite(name):
    module = NetworkModule(NETWORKS[name]())
    _, tensor = random_data(module.origin, (20, 24))
    expected = estimate(module, tensor)
    with torch.autocast("cpu", torch.bfloat16):
        rounded = estimate(module, tensor)
    assert abs(rounded.float() - expected).mean() < 0.03
    assert torch.isfinite(rounded).all()
    with torch.autocast("cpu", torch.bfloat16):
        module(tensor).float().square().mean().backward()
    for parameter in module.parameters():
        if parameter.requires_grad:
            assert torch.isfinite(parameter.grad).all()


@pytest.mark.slow
def test_the_module_compiles_into_one_graph_with_the_same_results():
    """The backend runs the traced graph without a C++ compiler."""
    module = NetworkModule(conditional("small"))
    torch._dynamo.reset()
    compiled = torch.compile(module, fullgraph=True, backend="aot_eager")
    _, tensor = random_data(module.origin, (11, 20))
    actual, expected = compiled(tensor, 16), module(tensor, 16)
    torch.testing.assert_close(actual, expected, atol=1e-5, rtol=0)
    gradients = [
        torch.autograd.grad(x.square().sum(), module.coefficients["4"]) for x in (actual, expected)
    ]
    torch.testing.assert_close(*gradients, atol=1e-4, rtol=1e-4)
    with torch.inference_mode():
        torch.testing.assert_close(compiled(tensor, 16), expected.detach(), atol=1e-5, rtol=0)


def test_only_trainable_parameters_require_gradients():
    module = NetworkModule(jl.Network.residual(SENSOR, "small", rng=0))
    for layer, filters in zip(module.origin.layers, module.filters, strict=True):
        assert filters.requires_grad == (layer.trainable != "nothing")
    for index, coefficients in module.coefficients.items():
        trainable = module.origin.layers[int(index)].trainable
        assert coefficients.requires_grad == (trainable == "all")


def test_further_training_does_not_change_a_returned_network():
    module = NetworkModule(jl.Network.residual(jl.Sensor(frames=4), "small", rng=0))
    network = module.to_network()
    before = network.layers[2].filters.copy()
    with torch.no_grad():
        module.filters[2].add_(1)
    np.testing.assert_array_equal(network.layers[2].filters, before)
