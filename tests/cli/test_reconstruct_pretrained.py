"""The choice of the method with and without a trained network for the sensor."""

import shlex

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.methods import METHODS
from jotlight.images.io import read_image
from jotlight.networks.pretrained import (
    pretrained,
    training_command,
    unsupported_message,
    unsupported_reason,
)

SUPPORTED = jl.Sensor(oversampling=4)
OTHER = jl.Sensor(oversampling=2, frames=100)
DEFAULT_ELSEWHERE = "non-iterative, total variation"


def expose(photo_folder, sensor):
    bits = sensor.expose(read_image(photo_folder / "0.png"), rng=0)
    jl.save(bits, "bits.npy")
    return bits


def test_reconstruct_uses_the_trained_network_and_prints_its_name(run, photo_folder):
    bits = expose(photo_folder, SUPPORTED)
    status, output = run("reconstruct", "bits.npy", "-o", "out.npy")
    assert status == 0
    assert "by network, medium in" in output
    assert "trained network" not in output
    np.testing.assert_array_equal(np.load("out.npy"), pretrained(SUPPORTED).reconstruct(bits))
    names = {"network-two-layer": "two-layer"} | {
        f"network-{name}": name for name in ("small", "medium", "large")
    }
    for method, quality in names.items():
        assert run("reconstruct", "bits.npy", "-o", "same.npy", "-m", method)[0] == 0
        expected = pretrained(SUPPORTED, quality).reconstruct(bits)
        np.testing.assert_array_equal(np.load("same.npy"), expected)


def test_without_a_network_the_chosen_method_and_a_training_command_are_printed(run, photo_folder):
    sensor = OTHER.replace(kernel="linear")
    bits = expose(photo_folder, sensor)
    status, output = run("reconstruct", "bits.npy", "-o", "out.npy")
    assert status == 0
    assert "by admm-tv: there is no trained network for the linear kernel" in output
    assert "train one for this capture with PyTorch" in output
    command = "jotlight train --sensor bits.npy --quality medium -o model.safetensors"
    assert output.endswith(f": {command}\n")
    assert "by ADMM, total variation" in output
    np.testing.assert_array_equal(np.load("out.npy"), METHODS["admm-tv"].run(bits, sensor))


def test_many_trials_are_estimated_by_the_blend_on_held_out_bits(run, photo_folder):
    sensor = jl.Sensor(oversampling=2, frames=300, gain=240.0)
    bits = expose(photo_folder, sensor)
    status, output = run("reconstruct", "bits.npy", "-o", "out.npy")
    assert status == 0
    assert "by best blend on held-out bits in" in output
    np.testing.assert_array_equal(np.load("out.npy"), METHODS["held-out"].run(bits, sensor))


def test_reconstruct_by_a_missing_network_fails(run, photo_folder, tmp_path):
    expose(photo_folder, OTHER)
    status, output = run("reconstruct", "bits.npy", "-o", "out.npy", "-m", "network-two-layer")
    assert status == 1
    reason = unsupported_reason(OTHER, "two-layer")
    assert output == f"error: {reason}; --quality medium serves this sensor\n"
    status, also = run("reconstruct", "bits.npy", "-o", "out.npy", "--quality", "two-layer")
    assert (status, also) == (1, output)
    assert not (tmp_path / "out.npy").exists()


def test_a_model_file_takes_precedence_without_advice(run, photo_folder):
    for sensor in (SUPPORTED, OTHER):
        bits = expose(photo_folder, sensor)
        network = jl.Network.initial(sensor, sigma=1.0)
        network.save("own.safetensors")
        arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--model", "own.safetensors"]
        status, output = run(*arguments)
        assert status == 0
        assert "trained network" not in output
        np.testing.assert_array_equal(np.load("out.npy"), network.reconstruct(bits))


def test_the_option_inverse_selects_the_noniterative_method(run, photo_folder):
    bits = expose(photo_folder, SUPPORTED)
    arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--inverse", "algebraic"]
    status, output = run(*arguments)
    assert status == 0
    assert f"by {DEFAULT_ELSEWHERE} in" in output
    expected = METHODS["noniterative-tv"].run(bits, SUPPORTED, inverse="algebraic")
    np.testing.assert_array_equal(np.load("out.npy"), expected)


def test_options_that_change_the_sensor_decide_whether_there_is_a_network(run, photo_folder):
    expose(photo_folder, SUPPORTED)
    arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--gain", 8]
    status, output = run(*arguments)
    assert status == 0
    assert "by network, medium in" in output
    status, output = run(*arguments, "-m", "network-two-layer")
    assert status == 1
    assert "0.5 detections per jot" in output


def test_counts_are_reconstructed_by_the_network(run, photo_folder):
    counts = expose(photo_folder, SUPPORTED).counts(4)
    np.save("counts.npy", counts)
    for arguments in (["-t", 16], ["-k", 4]):
        status, output = run("reconstruct", "counts.npy", "-o", "out.npy", *arguments)
        assert status == 0
        assert "by network, medium in" in output
        expected = pretrained(SUPPORTED).reconstruct(counts, SUPPORTED)
        np.testing.assert_array_equal(np.load("out.npy"), expected)


@pytest.mark.slow
def test_compare_shows_the_trained_network_where_there_is_one(run, photo_folder):
    status, output = run("compare", photo_folder / "0.png", "-k", 2, "-t", 4)
    assert status == 0
    assert "network, two-layer" in output
    assert "network, initial" in output
    assert "Without the trained network" not in output


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the light of a cubic kernel")
def test_compare_omits_a_missing_network_and_prints_the_reason(run, photo_folder):
    status, output = run("compare", photo_folder / "0.png", "-k", 2, "-t", 3)
    assert status == 0
    assert "network, two-layer" not in output
    assert "network, medium" in output
    status, output = run("compare", photo_folder / "0.png", "-k", 2, "-t", 3, "--kernel", "cubic")
    assert status == 0
    assert "network, medium" not in output
    assert "network, initial" in output
    assert "Without the trained network: there is no trained network for the cubic" in output
    status, output = run("compare", photo_folder / "0.png", "-k", 2, "-t", 3, "-m", "mle")
    assert status == 0
    assert "trained network" not in output


def test_compare_by_a_missing_network_fails(run, photo_folder, tmp_path):
    arguments = ["compare", photo_folder / "0.png", "-k", 2, "-t", 3, "-m", "mle,network-two-layer"]
    status, output = run(*arguments)
    assert status == 1
    assert output.startswith("error: network-two-layer: there is no trained network for 12 trials")
    assert not (tmp_path / "0-compare.png").exists()


@pytest.mark.slow
def test_demo_shows_the_trained_network(run):
    status, output = run("demo", "--photo", "coins")
    assert status == 0
    assert "network, two-layer" in output


DARK = np.full((96, 96), 0.3, np.float32)
DARK[::5] = 2.0
DARK[::5, ::2] = np.float32(0.05)

# Unsupported sensors, by the reason.
UNSUPPORTED = {
    "30 trials per pixel, only for 9, 16": jl.Sensor(frames=30),
    "the threshold 2, only for 1": jl.Sensor(oversampling=4, threshold=2),
    "0.5 detections per jot": jl.Sensor(oversampling=4, gain=8.0),
    "0.3333 detections per jot": jl.Sensor(oversampling=4, gain=16 / 3),
    "0.6667 detections per jot": jl.Sensor(oversampling=4, efficiency=2 / 3),
    "the cubic kernel, only for the box": jl.Sensor(oversampling=4, kernel="cubic"),
    "the largest intensity 2, only for 1": jl.Sensor(oversampling=4, max_intensity=2.0),
    "the largest intensity 1.33333": jl.Sensor(oversampling=4, max_intensity=4 / 3),
    "dark counts of 0.2": jl.Sensor(oversampling=4, dark_counts=0.2),
    "dark counts of 0.3": jl.Sensor(oversampling=4, dark_counts=DARK),
    "2 trials per pixel": jl.Sensor(
        frames=2, threshold=3, gain=10, efficiency=0.7, max_intensity=0.5, dark_counts=0.1
    ),
}


@pytest.mark.parametrize(("reason", "sensor"), UNSUPPORTED.items(), ids=UNSUPPORTED)
def test_an_unsupported_sensor_gets_the_reason_and_advice_that_works(reason, sensor):
    with pytest.raises(ValueError, match="there is no trained network for") as caught:
        pretrained(sensor, "two-layer")
    message = str(caught.value)
    assert unsupported_message(sensor, "two-layer") == message
    assert reason in message
    if sensor.kernel == "box":
        assert message.endswith('; quality="medium" (--quality medium) serves this sensor')
        assert np.isfinite(pretrained(sensor, "medium").reconstruct(bits_of(sensor))).all()
    else:
        assert training_command(sensor) in message


@pytest.mark.parametrize("sensor", UNSUPPORTED.values(), ids=UNSUPPORTED)
def test_the_training_command_describes_the_sensor(run, photo_folder, sensor):
    arguments = shlex.split(training_command(sensor))[1:]
    assert arguments[arguments.index("--quality") + 1] == "medium"
    arguments[arguments.index("FOLDER_OF_PHOTOGRAPHS")] = str(photo_folder)
    # Without PyTorch, a two-layer network shows that the options of the sensor are right.
    quick = ["--quality", "two-layer", "--steps", 1, "--patch", 24, "--batch", 2]
    status, output = run(*arguments, *quick, "--optimizer", "adam")
    assert status == 0, output
    jl.save(bits_of(sensor), "bits.npy")
    status, output = run("reconstruct", "bits.npy", "-o", "out.npy", "--model", "model.safetensors")
    assert status == 0, output
    assert np.isfinite(np.load("out.npy")).all()


def bits_of(sensor):
    """Return the bits of a photograph of 24 x 24 pixels."""
    return sensor.expose(jl.datasets.photograph("camera")[100:124, 180:204], rng=0)
