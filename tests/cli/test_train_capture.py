"""`jotlight train --sensor CAPTURE`: networks for the sensor and the brightness of a capture."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.brightness import HEADROOM, training_sensor
from jotlight.networks.network import Network


@pytest.fixture
def capture(tmp_path):
    """Save and return a dim capture of 16 frames with its sensor."""
    scene = 0.3 * jl.datasets.photograph("camera")[100:164, 180:244]
    dark = np.full((64, 64), 0.01)
    dark[5, 7] = 0.5
    bits = jl.Sensor(frames=16, dark_counts=dark).expose(scene, rng=0)
    jl.save(bits, tmp_path / "capture.npy")
    return bits


SHORT_RUN = ("--steps", "2", "--batch", "8")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["capture.npy", "capture.json"])
def test_a_network_trained_for_a_capture_reconstructs_it(run, tmp_path, capture, name):
    status, output = run("train", "--sensor", name, "-o", "own.safetensors", *SHORT_RUN)
    assert status == 0, output
    own = Network.load(tmp_path / "own.safetensors")
    _, scale = training_sensor(capture, capture.sensor)
    assert f"the brightness of the scene is {scale:.3g}" in output
    assert own.sensor.max_intensity == pytest.approx(HEADROOM * scale)
    assert own.sensor.frames == 16
    assert own.history["stages"][-1]["data"] == "photographs of scikit-image"
    status, output = run(
        "reconstruct", name.replace("json", "npy"), "-o", "own.npy", "--model", "own.safetensors"
    )
    assert status == 0, output
    expected = own.reconstruct(capture, capture.sensor.replace(max_intensity=HEADROOM * scale))
    np.testing.assert_array_equal(np.load(tmp_path / "own.npy"), expected)


@pytest.mark.slow
def test_training_scenes_are_as_bright_as_the_capture(run, tmp_path, capture):
    run("train", "--sensor", "capture.npy", "-o", "own.safetensors", *SHORT_RUN)
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    _, scale = training_sensor(capture, capture.sensor)
    photo = jl.datasets.photograph("camera")
    np.save(scenes / "0.npy", photo)
    np.save(scenes / "1.npy", photo[::-1])
    status, output = run(
        "train", "scenes", "--sensor", "capture.npy", "-o", "two.safetensors", *SHORT_RUN
    )
    assert status == 0, output
    sensor = Network.load(tmp_path / "two.safetensors").sensor
    images = [np.float32(scale) * photo, np.float32(scale) * photo[::-1]]
    expected, _ = jl.train(Network.initial(sensor), images, sensor, steps=2, batch=8, rng=0)
    trained = Network.load(tmp_path / "two.safetensors")
    for ours, theirs in zip(trained.layers, expected.layers, strict=True):
        np.testing.assert_allclose(ours.filters, theirs.filters, atol=1e-6)
        np.testing.assert_allclose(ours.coefficients, theirs.coefficients, atol=1e-6)


@pytest.mark.slow
def test_a_network_can_be_trained_for_fewer_frames_and_for_counts(run, tmp_path, capture):
    status, output = run(
        "train", "--sensor", "capture.npy", "--frames", "4", "-o", "w.safetensors", *SHORT_RUN
    )
    assert status == 0, output
    assert Network.load(tmp_path / "w.safetensors").sensor.frames == 4
    np.save(tmp_path / "counts.npy", capture.counts())
    status, output = run(
        "train", "--sensor", "counts.npy", "--frames", "16", "-o", "c.safetensors", *SHORT_RUN
    )
    assert status == 0, output
    assert Network.load(tmp_path / "c.safetensors").sensor.frames == 16


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("", "expected a folder of photographs"),
        ("--sensor none.npy", "none.npy"),
        ("--sensor alone.json", "expected the bits beside it, alone.npy"),
        ("--sensor counts.npy", "counts of an unknown number of trials"),
        ("--sensor counts.npy --start x.safetensors", "leave out --sensor"),
        ("--sensor counts.npy --frames 16 --key a", "--sensor-key names an array of the capture"),
        ("--sensor counts.npy --frames 16 --white 3", "white: is a level of images in files"),
        ("synthetic --sensor-key a", "sensor-key: is for a capture; name one with --sensor"),
        ("synthetic --rotate 90", "rotate: is for a capture; name one with --sensor"),
        (
            "synthetic --calibration x.safetensors",
            "calibration: is for a capture; name one with --sensor",
        ),
        (
            "--sensor counts.npy --frames 16 --seconds 0",
            "seconds: expected a finite number above 0",
        ),
        ("--sensor counts.npy --frames 16 --calibration x.safetensors", "got a jotlight network"),
    ],
)
def test_captures_that_cannot_be_trained_for_are_refused(run, tmp_path, arguments, message):
    (tmp_path / "alone.json").write_text("{}")
    np.save(tmp_path / "counts.npy", np.ones((16, 16), int))
    jl.Network.initial(jl.Sensor(frames=4)).save(tmp_path / "x.safetensors")
    status, output = run("train", *arguments.split(), "-o", "n.safetensors")
    assert status == 1
    assert message in output
