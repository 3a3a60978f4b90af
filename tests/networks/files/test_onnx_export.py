"""Networks as ONNX models, compared with the engine."""

import json
import sys

import numpy as np
import pytest

import jotlight as jl
from reference import deep
from reference.dim_scenes import plain_estimate
from reference.networks import random_bits, random_network

pytestmark = pytest.mark.slow

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

SENSOR = jl.Sensor(oversampling=4)
SIZES = [(1, 1), (2, 5), (33, 47), (64, 40)]
TOLERANCE = 1e-4

SENSORS = {
    "one trial": jl.Sensor(),
    "256 trials": jl.Sensor(frames=256),
    "1000 trials": jl.Sensor(frames=1000),
    "10000 trials": jl.Sensor(frames=10_000, gain=2000.0),
    "dark": jl.Sensor(frames=16, gain=1.0),
    "bright": jl.Sensor(frames=16, gain=60.0, max_intensity=2.0),
    "dark counts, efficiency": jl.Sensor(frames=25, dark_counts=0.1, efficiency=0.3),
    "threshold 2": jl.Sensor(frames=16, threshold=2, gain=40.0, dark_counts=0.01),
    "threshold 6": jl.Sensor(frames=256, threshold=6, gain=2000.0),
    "far above saturation": jl.Sensor(frames=16, threshold=3, gain=60.0, max_intensity=90.0),
}


def run(path, data):
    """Return the intensities of a model for a batch."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(path, options)
    (intensity,) = session.run(None, {session.get_inputs()[0].name: data.astype(np.float32)})
    return intensity


def random_counts(sensor, size, number=1):
    """Return images of counts of every brightness, with dark and with saturated pixels."""
    rng = np.random.default_rng(1)
    probability = rng.beta(0.7, 0.7, (number, *size))
    return rng.binomial(sensor.trials, probability).astype(np.int32)


def assert_agrees(network, sensor, counts, folder, tolerance=TOLERANCE):
    path = folder / "network.onnx"
    network.export_onnx(path, sensor)
    actual = run(path, counts[:, None])
    assert actual.shape == (len(counts), 1, *counts.shape[1:])
    served = sensor or network.default_sensor
    for intensity, image in zip(actual[:, 0], counts, strict=True):
        # Models do not combine trials, correct dark regions, or look at squares of pixels.
        if network.trials_range is not None:
            expected = plain_estimate(network, image, served)
        else:
            expected = network.reconstruct(image, served)
        np.testing.assert_allclose(intensity, expected, atol=tolerance)


@pytest.mark.parametrize("quality", ["two-layer", "small", "medium", "large"])
@pytest.mark.parametrize("size", SIZES)
def test_the_model_returns_the_estimate_of_the_engine(quality, size, tmp_path):
    network = jl.pretrained(SENSOR, quality)
    assert_agrees(network, None, random_counts(SENSOR, size, 3), tmp_path, 1e-5)


@pytest.mark.parametrize("quality", ["two-layer", "small", "medium", "large"])
def test_the_model_has_the_quality_of_the_engine_on_a_photograph(quality, tmp_path):
    image = jl.datasets.photograph("camera")[100:233, 180:325]
    counts = SENSOR.expose(image, rng=0).counts()
    network = jl.pretrained(SENSOR, quality)
    network.export_onnx(tmp_path / "network.onnx")
    estimate = run(tmp_path / "network.onnx", counts[None, None])[0, 0]
    expected = network.reconstruct(counts)
    np.testing.assert_allclose(estimate, expected, atol=1e-5)
    assert jl.metrics.psnr(estimate, image) > 23


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
def test_the_model_of_a_conditional_network_serves_every_exposure(sensor, tmp_path):
    assert_agrees(jl.pretrained(sensor), None, random_counts(sensor, (37, 50)), tmp_path)


@pytest.mark.parametrize("photons", [0.01, 0.1, 1.0, 5.0, 10.0, 25.0])
@pytest.mark.parametrize("frames", [1, 16, 256, 1000])
def test_the_model_agrees_from_dark_to_saturated(frames, photons, tmp_path):
    sensor = jl.Sensor(frames=frames, gain=photons * frames)
    image = jl.datasets.photograph("camera")[100:164, 180:260]
    scene = sensor.expose(image, rng=0).counts()
    saturated = np.random.default_rng(0).binomial(frames, 0.99, image.shape).astype(np.int32)
    assert_agrees(jl.pretrained(sensor), None, np.stack([scene, saturated]), tmp_path)
    if (frames, photons) == (16, 1.0):  # the only one that the other sizes serve
        for quality in ("small", "large"):
            network = jl.pretrained(sensor, quality)
            assert_agrees(network, None, np.stack([scene, saturated]), tmp_path)


@pytest.mark.parametrize("quality", ["two-layer", "small"])
def test_the_model_takes_account_of_other_dark_counts(quality, tmp_path):
    sensor = jl.Sensor(frames=16, gain=32.0, efficiency=0.5, dark_counts=0.04)
    network = jl.pretrained(sensor, quality)
    assert_agrees(network, sensor, random_counts(sensor, (21, 30)), tmp_path, 1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_models_of_random_graphs_agree_with_the_engine(seed, tmp_path):
    network = deep.random_graph(np.random.default_rng(seed), SENSOR)
    assert_agrees(network, SENSOR, random_counts(SENSOR, (19, 26)), tmp_path)


@pytest.mark.parametrize(
    "network",
    [
        random_network(
            np.random.default_rng(2),
            jl.Sensor(oversampling=3, frames=2),
            [2, 1],
            [(5, 4)],
            tied=False,
        ),
        deep.random_graph(np.random.default_rng(3), SENSOR, tied=False),
    ],
    ids=["two layers", "random graph"],
)
def test_models_of_untied_networks_take_bits(network, tmp_path):
    bits = random_bits(np.random.default_rng(4), network.sensor, 13, 18)
    network.export_onnx(tmp_path / "network.onnx")
    actual = run(tmp_path / "network.onnx", bits[None])
    expected = network.reconstruct(jl.Bits.from_array(bits))
    np.testing.assert_allclose(actual[0, 0], expected, atol=TOLERANCE)


def test_the_model_has_standard_operators_and_states_its_sensor_and_history(tmp_path):
    paths = tmp_path / "a.onnx", tmp_path / "b.onnx"
    network = jl.pretrained(SENSORS["threshold 2"])
    for path in paths:
        network.export_onnx(path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    model = onnx.load(paths[0])
    assert {node.domain for node in model.graph.node} == {""}
    assert not model.functions
    metadata = {each.key: each.value for each in model.metadata_props}
    assert json.loads(metadata["jotlight sensor"]) == SENSORS["threshold 2"].scalars()
    assert json.loads(metadata["jotlight history"]) == network.history


def test_sensors_that_the_model_cannot_have_are_refused(tmp_path):
    path = tmp_path / "network.onnx"
    network = jl.pretrained(SENSOR, "small")
    with pytest.raises(ValueError, match="sensor: expected the sensor of the data"):
        jl.Network.conditional("small", rng=0).export_onnx(path)
    with pytest.raises(ValueError, match="sensor: the network needs data with its own trials"):
        network.export_onnx(path, jl.Sensor(frames=15))
    with pytest.raises(ValueError, match="sensor: expected one without maps of its jots"):
        network.export_onnx(path, SENSOR.replace(mask=np.eye(8, dtype=bool)))
    untied = jl.Network.initial(SENSOR, tied=False)
    with pytest.raises(ValueError, match="expected the network's efficiency and dark counts"):
        untied.export_onnx(path, SENSOR.replace(dark_counts=0.1))
    assert not path.exists()


def test_without_the_package_the_error_says_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "jotlight.networks.files.onnx_graph", raising=False)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[onnx\]'"):
        jl.pretrained(SENSOR).export_onnx(tmp_path / "network.onnx")
