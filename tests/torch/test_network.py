"""Networks as PyTorch modules."""

import copy
import pickle

import numpy as np
import pytest

import jotlight as jl
from reference import deep
from reference.networks import last_layer, random_bits, random_network

torch = pytest.importorskip("torch")
from jotlight.torch import Network  # noqa: E402

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
        return module.run_layers(data, trials)


@pytest.mark.parametrize("make", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("size", SIZES)
def test_the_module_returns_the_estimate_of_the_engine(make, size):
    network = make()
    data, tensor = random_data(network, size)
    actual = estimate(Network(network), tensor)
    assert actual.shape == (1, 1, *size)
    np.testing.assert_allclose(actual[0, 0], last_layer(network, data), atol=1e-5)


@pytest.mark.parametrize("make", CONDITIONAL.values(), ids=CONDITIONAL)
@pytest.mark.parametrize("trials", [1, 16, 256])
@pytest.mark.parametrize("size", SIZES)
def test_a_conditional_module_returns_the_probabilities_of_the_engine(make, trials, size):
    network, sensor = make(), jl.Sensor(frames=trials)
    counts = np.random.default_rng(5).integers(0, trials + 1, (2, *size))
    with torch.no_grad():
        actual = Network(network).run_layers(torch.from_numpy(counts).float()[:, None], trials)
    conditioned = jl.Network(network.conditioned_layers(trials), sensor)
    for image, probability in zip(counts, actual[:, 0], strict=True):
        np.testing.assert_allclose(probability, last_layer(conditioned, image), atol=1e-5)


def test_only_conditional_modules_take_the_number_of_trials():
    data = torch.zeros(1, 1, 4, 4)
    for network, trials in ((conditional("small"), None), (residual("small"), 16)):
        with pytest.raises(ValueError, match="trials: expected K for a K-conditioned network"):
            Network(network).run_layers(data, trials)


@pytest.mark.parametrize("make", [lambda: conditional("small"), lambda: residual("small")])
def test_a_sensor_in_place_of_the_number_of_trials_is_refused(make):
    with pytest.raises(TypeError, match=r"trials: expected K, .*: pass sensor\.trials"):
        Network(make()).run_layers(torch.zeros(1, 1, 4, 4), jl.Sensor(frames=16))


@pytest.mark.parametrize("name", ["save", "reconstruct", "halo", "precision"])
def test_what_the_engine_has_is_named_on_the_module(name):
    module = Network(residual("small"))
    with pytest.raises(
        AttributeError, match=rf"'Network' .*'{name}'; write (module\.to_n.*)$"
    ) as info:
        getattr(module, name)
    call = str(info.value).partition("write ")[2]
    assert eval(call, {"module": module}) is not None
    with pytest.raises(AttributeError, match=r"has no attribute 'other'$"):
        _ = module.other


@every_network
def test_a_network_passes_through_the_module_unchanged(tmp_path, make):
    start = make()
    network = Network(start).to_network()
    paths = tmp_path / "start.safetensors", tmp_path / "again.safetensors"
    start.save(paths[0])
    network.save(paths[1])
    assert paths[0].read_bytes() == paths[1].read_bytes()
    again = Network(jl.Network.load(paths[1]))
    for before, after in zip(Network(start).parameters(), again.parameters(), strict=True):
        assert torch.equal(before, after)
        assert before.requires_grad == after.requires_grad


@every_network
def test_a_state_dict_a_copy_and_a_pickle_hold_the_whole_module(make):
    module = Network(make())
    _, tensor = random_data(module.origin, (9, 14))
    expected = estimate(module, tensor)
    other = Network(make())
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
    module = Network(NETWORKS[name]()).double()
    _, tensor = random_data(module.origin, (5, 6))
    trainable = [parameter for parameter in module.parameters() if parameter.requires_grad]

    def values(*parameters):
        names = [n for n, p in module.named_parameters() if p.requires_grad]
        named = dict(zip(names, parameters, strict=True))
        return torch.func.functional_call(module, named, (tensor.double(), module.origin.sensor))

    # Whole counts lie on knots, where a finite difference mixes two cubics; hence `atol`.
    assert torch.autograd.gradcheck(values, trainable, fast_mode=True, atol=1e-4)


def test_torch_func_returns_the_gradient_of_autograd():
    module = Network(residual("small"))
    _, data = random_data(module.origin, (9, 14))
    actual = torch.func.grad(lambda x: module(x, SENSOR).sum())(data)
    data.requires_grad_()
    (expected,) = torch.autograd.grad(module(data, SENSOR).sum(), data)
    torch.testing.assert_close(actual, expected)


@pytest.mark.parametrize("name", ["initial", "small"])
def test_autocast_to_bfloat16_changes_estimates_little_and_keeps_gradients_finite(name):
    module = Network(NETWORKS[name]())
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
@pytest.mark.parametrize("dark_counts", [0.0, 0.03])
@pytest.mark.parametrize("quality", ["small", "medium"])
def test_a_network_compiles_into_one_graph_with_the_same_results(quality, dark_counts):
    """The backend runs the traced graph without a C++ compiler."""
    network = Network(jl.pretrained(jl.Sensor(frames=16, dark_counts=dark_counts), quality))
    torch._dynamo.reset()
    compiled = torch.compile(network, fullgraph=True, backend="aot_eager")
    counts = torch.arange(220.0).reshape(1, 1, 11, 20) % 17
    actual, expected = compiled(counts), network(counts)
    torch.testing.assert_close(actual, expected, atol=1e-5, rtol=0)
    gradients = [
        torch.autograd.grad(x.square().sum(), network.coefficients["4"]) for x in (actual, expected)
    ]
    torch.testing.assert_close(*gradients, atol=1e-4, rtol=1e-4)
    with torch.inference_mode():
        torch.testing.assert_close(compiled(counts), expected.detach(), atol=1e-5, rtol=0)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The .grad attribute")  # by PyTorch, between two graphs
@pytest.mark.parametrize("mode", [torch.enable_grad, torch.inference_mode])
def test_a_network_compiles_for_a_sensor_with_a_larger_threshold(mode):
    network = Network(jl.pretrained(jl.Sensor(frames=16, threshold=2, gain=32.0), "small"))
    torch._dynamo.reset()
    counts = torch.arange(220.0).reshape(1, 1, 11, 20) % 17
    with mode():
        actual = torch.compile(network, backend="aot_eager")(counts)
        torch.testing.assert_close(actual, network(counts), atol=1e-5, rtol=0)


def test_only_trainable_parameters_require_gradients():
    module = Network(jl.Network.residual(SENSOR, "small", rng=0))
    for layer, filters in zip(module.origin.layers, module.filters, strict=True):
        assert filters.requires_grad == (layer.trainable != "nothing")
    for index, coefficients in module.coefficients.items():
        trainable = module.origin.layers[int(index)].trainable
        assert coefficients.requires_grad == (trainable == "all")


def test_further_training_does_not_change_a_returned_network():
    module = Network(jl.Network.residual(jl.Sensor(frames=4), "small", rng=0))
    network = module.to_network()
    before = network.layers[2].filters.copy()
    with torch.no_grad():
        module.filters[2].add_(1)
    np.testing.assert_array_equal(network.layers[2].filters, before)


def test_parameters_that_change_are_a_stage_of_the_history(tmp_path):
    start = jl.pretrained(SENSOR, "two-layer")
    start.save(tmp_path / "own.safetensors")
    module = Network(tmp_path / "own.safetensors")
    assert module.to_network().history == start.history
    with torch.no_grad():
        module.coefficients["1"][0, 0] += 1e-3
    expected = [*start.history["stages"], "parameters changed in PyTorch, and not measured since"]
    changed = module.to_network()
    assert changed.history == {**start.history, "stages": expected}
    assert Network(changed).to_network().history == changed.history


def test_a_network_loads_from_a_file_onto_a_device(tmp_path):
    path = tmp_path / "mine.safetensors"
    residual("small").save(path)
    counts = torch.arange(220.0).reshape(1, 1, 11, 20) % 17
    expected = Network(residual("small"))(counts)
    for network in (Network(path), Network(str(path)), Network.load(path, device="cpu")):
        assert torch.equal(network(counts), expected)
    for network in (Network.load(path, device="meta"), Network(path, device=torch.device("meta"))):
        assert {parameter.device.type for parameter in network.parameters()} == {"meta"}
    with pytest.raises(FileNotFoundError, match="there is no network file"):
        Network.load(tmp_path / "other.safetensors")


def test_a_trained_network_keeps_the_sensor_of_its_counts():
    sensor = jl.Sensor(frames=20, gain=10.0)
    counts = torch.arange(220.0).reshape(1, 1, 11, 20) % 21
    module = Network(jl.pretrained(sensor))
    again = Network(module.to_network())
    assert torch.equal(again(counts), module(counts, sensor))


@pytest.mark.parametrize("dark_counts", [0.0, 0.01, 0.04])
@pytest.mark.parametrize("quality", ["two-layer", "small", "medium"])
def test_intensities_are_those_of_the_engine_for_other_dark_counts(quality, dark_counts):
    sensor = jl.Sensor(frames=16, gain=32.0, efficiency=0.5, dark_counts=dark_counts)
    counts = np.random.default_rng(6).integers(0, 17, (21, 30))
    network = jl.pretrained(sensor, quality)
    with torch.no_grad():
        actual = Network(network)(torch.from_numpy(counts)[None, None])
    np.testing.assert_allclose(actual[0, 0], network.reconstruct(counts), atol=1e-5)


def test_gradients_for_other_dark_counts_are_finite_up_to_saturation():
    network = Network(jl.pretrained(jl.Sensor(frames=16, dark_counts=0.03), "small"))
    counts = torch.arange(17.0).reshape(1, 1, 1, 17).requires_grad_()
    network(counts).sum().backward()
    assert torch.isfinite(counts.grad).all()


@pytest.mark.parametrize("shape", [(5, 6), (1, 5, 6), (5, 6, 3, 3), (1, 1, 0, 8), (1, 1, 8, 0)])
def test_data_of_other_shapes_are_refused(shape):
    with pytest.raises(
        ValueError, match=r"data: expected counts \(N, 1, H, W\) and at least one pixel, got shape"
    ):
        Network(residual("small"))(torch.zeros(shape))


@pytest.mark.parametrize("shape", [(1, 2, 0, 9), (1, 2, 9, 10), (1, 2, 2, 9)])
def test_bits_without_whole_pixels_are_refused(shape):
    message = (
        r"expected bits \(N, 2, H·K̂, W·K̂\) with K̂ = 3 and at least one pixel, got shape \(1, 2, "
    )
    with pytest.raises(ValueError, match=message):
        Network(build_two_layer(tied=False))(torch.zeros(shape))


def test_an_empty_batch_is_legal():
    assert Network(residual("small"))(torch.zeros(0, 1, 5, 6)).shape == (0, 1, 5, 6)


def test_an_image_without_the_axes_of_a_batch_gets_advice():
    with pytest.raises(ValueError, match=r"got shape \(5, 6\); .* write data\[None, None\]"):
        Network(residual("small"))(torch.zeros(5, 6))


def test_arrays_and_bits_are_refused():
    bits = SENSOR.expose(np.full((5, 6), 0.5), rng=0)
    for data in (bits, bits.counts()):
        with pytest.raises(TypeError, match=r"write torch\.from_numpy\(counts\)\[None, None\]"):
            Network(residual("small"))(data)


def test_anything_but_a_network_and_a_sensor_is_refused():
    with pytest.raises(TypeError, match=r"source: expected jotlight\.Network or .*, got Sensor;?"):
        Network(jl.Sensor())
    network = Network(jl.Network.conditional("small", rng=0))
    with pytest.raises(TypeError, match=r"sensor: expected a jotlight\.Sensor, .*got 16$"):
        network(torch.zeros(1, 1, 8, 8), 16)


def test_sensors_that_a_network_does_not_serve_are_refused():
    counts = torch.zeros(1, 1, 4, 4)
    with pytest.raises(ValueError, match="sensor: expected the sensor of the data"):
        Network(conditional("small"))(counts)
    with pytest.raises(ValueError, match="sensor: the network needs data with its own trials"):
        Network(residual("small"))(counts, jl.Sensor(frames=15))
    sensor = jl.Sensor(oversampling=3, frames=2)
    network, bits = Network(build_two_layer(tied=False)), torch.zeros(1, 2, 6, 6)
    assert network(bits, sensor).shape == (1, 1, 2, 2)
    with pytest.raises(ValueError, match="expected the network's efficiency and dark counts"):
        network(bits, sensor.replace(dark_counts=0.1))


@pytest.mark.parametrize("sensor", [jl.Sensor(bit_depth=4), jl.Sensor(read_noise=0.3)])
def test_readings_that_are_not_plain_bits_are_refused(sensor):
    with pytest.raises(ValueError, match="sensor: expected single bits without noise"):
        Network(conditional("small"))(torch.zeros(1, 1, 4, 4), sensor)
