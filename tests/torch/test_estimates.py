"""Intensities of networks in PyTorch: the engine's, with derivatives."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.inverse_response import intensity_from_probability as of_engine

torch = pytest.importorskip("torch")
from jotlight.torch.estimates import intensity_from_probability  # noqa: E402
from jotlight.torch.network import Network  # noqa: E402

IMAGE = jl.datasets.photograph("camera")[100:148, 180:228].astype(np.float32)
SENSORS = [
    jl.Sensor(frames=16),
    jl.Sensor(frames=16, gain=40.0, threshold=3, dark_counts=0.02, max_intensity=3.0),
    jl.Sensor(frames=9, oversampling=2, efficiency=0.4, threshold=2),
]


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_inverse_is_that_of_the_engine(sensor):
    p = np.linspace(0, 1, 400, dtype=np.float32)
    found = intensity_from_probability(torch.from_numpy(p), sensor)
    np.testing.assert_allclose(found, of_engine(p, sensor, None), atol=2e-5)


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_derivative_agrees_with_finite_differences(sensor):
    middle = 0.5 * sensor.max_intensity
    p = float(sensor.probability(np.full((1, 1), middle))[0, 0])
    point = torch.tensor([p], dtype=torch.float64, requires_grad=True)
    intensity_from_probability(point, sensor).backward()
    step = 1e-5
    ends = intensity_from_probability(
        torch.tensor([p - step, p + step], dtype=torch.float64), sensor
    )
    assert point.grad.item() == pytest.approx((ends[1] - ends[0]).item() / (2 * step), rel=1e-4)


def test_gradients_are_finite_at_the_ends():
    for sensor in SENSORS:
        point = torch.tensor([0.0, 1.0], requires_grad=True)
        intensity_from_probability(point, sensor).sum().backward()
        assert torch.isfinite(point.grad).all()


@pytest.mark.parametrize("photons", [0.05, 0.2, 0.7, 1.5, 3.0])
@pytest.mark.parametrize("trials", [1, 16, 256, 1000, 10_000])
def test_the_quality_is_that_of_the_engine_at_any_exposure(photons, trials):
    sensor = jl.Sensor(frames=trials, gain=photons * trials / float(IMAGE.mean()))
    counts = sensor.expose(IMAGE, rng=0).counts()
    network = jl.pretrained(sensor)
    with torch.no_grad():
        found = Network(network)(torch.from_numpy(counts).float()[None, None])
    qualities = [
        jl.metrics.psnr(estimate, IMAGE) for estimate in (found[0, 0].numpy(), network(counts))
    ]
    assert qualities[0] == pytest.approx(qualities[1], abs=1e-3)


@pytest.mark.parametrize("photons", [0.01, 0.1, 1.0, 5.0, 10.0, 25.0])
@pytest.mark.parametrize("trials", [1, 16, 256, 1000])
def test_the_intensities_are_those_of_the_engine_from_dark_to_saturated(photons, trials):
    sensor = jl.Sensor(frames=trials, gain=photons * trials)
    scene = sensor.expose(IMAGE, rng=0).counts()
    saturated = np.random.default_rng(0).binomial(trials, 0.99, IMAGE.shape).astype(np.int32)
    sizes = ["medium"] if (trials, photons) != (16, 1.0) else ["small", "medium", "large"]
    for network in (jl.pretrained(sensor, size) for size in sizes):
        for counts in (scene, saturated):
            with torch.no_grad():
                found = Network(network)(torch.from_numpy(counts).float()[None, None])
            expected = network(counts)
            # Intensities up to this distance have the same probability in single precision.
            step = 2.0**-24 / (photons * np.exp(-photons * expected))
            assert (abs(found[0, 0].numpy() - expected) < 1e-4 + step).all()


def test_gradients_near_saturation_are_finite():
    sensor = jl.Sensor(frames=16, gain=25.0 * 16)
    counts = torch.full((1, 1, 16, 16), 16.0, requires_grad=True)
    network = Network(jl.pretrained(sensor))
    network(counts).sum().backward()
    assert torch.isfinite(counts.grad).all()
    assert all(
        torch.isfinite(each.grad).all() for each in network.parameters() if each.grad is not None
    )


def test_sensors_with_maps_are_refused():
    sensor = jl.Sensor(frames=16, dark_counts=np.full((48, 48), 0.1))
    with pytest.raises(ValueError, match="without maps of its jots"):
        Network(jl.pretrained(sensor))(torch.zeros(1, 1, 48, 48))


def test_reconstruct_takes_a_module():
    sensor = jl.Sensor(frames=16)
    bits = sensor.expose(jl.datasets.photograph("camera")[::8, ::8], rng=0)
    network = jl.pretrained(sensor, "small")
    module = jl.torch.Network(network)
    np.testing.assert_array_equal(jl.reconstruct(bits, method=module), network.reconstruct(bits))
    assert jl.compare({"mine": module}, np.full((32, 32), 0.5), sensor).results[0].psnr > 20


@pytest.mark.filterwarnings("ignore:There is a performance drop")
def test_dim_scenes_are_estimated_in_every_mode_without_gradients():
    sensor = jl.Sensor(frames=256, gain=2.56)
    counts = torch.from_numpy(sensor.expose(IMAGE, rng=0).counts()).float()[None, None]
    network = Network(jl.pretrained(sensor))
    with torch.no_grad():
        expected = network(counts)
        assert network(counts[:0]).shape == (0, 1, *IMAGE.shape)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            assert torch.isfinite(network(counts)).all()
        mapped = torch.func.vmap(network)(counts[None])
    assert mapped.shape == (1, *expected.shape)


@pytest.mark.parametrize(
    ("frames", "photons", "threshold"), [(1, 0.5, 1), (64, 0.002, 1), (64, 2.0, 3), (30, 5.0, 8)]
)
def test_images_of_few_photons_are_those_of_the_engine(frames, photons, threshold):
    image = jl.datasets.photograph("camera")[60:125, 160:223].astype(float)
    sensor = jl.Sensor(frames=frames, gain=frames * photons, threshold=threshold)
    counts = sensor.expose(np.stack([image, image[::-1]]), rng=0)
    counts = np.stack([each.counts() for each in counts])
    own = jl.pretrained(sensor)
    with torch.no_grad():
        found = Network(own)(torch.from_numpy(counts).float()[:, None], sensor)
    np.testing.assert_allclose(found[:, 0].numpy(), own.reconstruct(counts, sensor), atol=2e-4)


@pytest.mark.parametrize("name", ["bool", "uint8", "int8", "uint16", "float16"])
def test_counts_of_narrow_types_have_the_estimates_of_floats(name):
    frames = 1 if name == "bool" else 100
    # With lamps, sums of squares exceed 8 bits although the scene has few photons.
    scene = 0.002 * IMAGE
    scene[20:24, 20:24] = 1.0
    sensor = jl.Sensor(frames=frames, gain=1.0 * frames)
    network = Network(jl.Network.conditional("small", rng=0))
    counts = torch.from_numpy(sensor.expose(scene, rng=0).counts())[None, None]
    with torch.no_grad():
        found = network(counts.to(getattr(torch, name)), sensor)
        assert torch.equal(found, network(counts, sensor))


def test_bright_sensors_take_bits():
    sensor = jl.Sensor(gain=25.0)
    counts = torch.from_numpy(sensor.expose(IMAGE, rng=0).counts())[None, None]
    network = Network(jl.Network.conditional("small", rng=0))
    assert torch.equal(network(counts.bool(), sensor), network(counts, sensor))


@pytest.mark.parametrize("mode", [torch.no_grad, torch.enable_grad])
@pytest.mark.filterwarnings("ignore:`torch.jit.trace` is deprecated")
def test_a_trace_is_refused(mode):
    network = Network(jl.Network.conditional("small", rng=0))
    with mode(), pytest.raises(RuntimeError, match=r"torch\.jit\.trace: .* torch\.compile"):
        torch.jit.trace(lambda x: network(x, jl.Sensor(frames=8)), torch.ones(1, 1, 24, 24))


def test_models_by_the_exporter_of_pytorch_do_not_depend_on_values(monkeypatch):
    sensor = jl.Sensor(frames=64, gain=0.64)
    network = Network(jl.Network.conditional("small", rng=0))
    counts = torch.from_numpy(sensor.expose(IMAGE, rng=0).counts())[None, None]
    expected = network(counts, sensor).detach()
    monkeypatch.setattr(torch.onnx, "is_in_onnx_export", lambda: True)
    with torch.no_grad():
        torch.testing.assert_close(network(counts, sensor), expected)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::torch.jit.TracerWarning", "ignore:Constant folding")
def test_pytorch_exports_a_network_for_one_number_of_trials_to_onnx(tmp_path):
    onnxruntime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    module = Network(jl.Network.initial(jl.Sensor(frames=8)))
    counts, path = torch.full((1, 1, 8, 8), 5.0), str(tmp_path / "model.onnx")
    torch.onnx.export(module, (counts,), path, dynamo=False, input_names=["counts"])
    (found,) = onnxruntime.InferenceSession(path).run(None, {"counts": counts.numpy()})
    torch.testing.assert_close(torch.from_numpy(found), module(counts).detach())
