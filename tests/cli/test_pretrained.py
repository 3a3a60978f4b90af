"""What the commands do where there is a trained network for the sensor, and where there is none."""

import shlex

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.methods import METHODS
from jotlight.images.io import read_image
from jotlight.networks.pretrained import pretrained, unsupported_message, unsupported_reason

SERVED = jl.Sensor(oversampling=4)
OTHER = jl.Sensor(oversampling=2, frames=100)
DEFAULT_ELSEWHERE = "non-iterative, total variation"


def expose(pictures, sensor):
    bits = sensor.expose(read_image(pictures / "0.png"), rng=0)
    jl.save(bits, "bits.npy")
    return bits


def test_reconstruct_takes_the_learned_network_where_there_is_one_and_says_so(run, pictures):
    bits = expose(pictures, SERVED)
    status, said = run("reconstruct", "bits.npy", "-o", "out.npy")
    assert status == 0
    assert "by network, medium in" in said
    assert "trained network" not in said
    np.testing.assert_array_equal(np.load("out.npy"), pretrained(SERVED).reconstruct(bits))
    names = {"network-two-layer": "two-layer"} | {
        f"network-{name}": name for name in ("small", "medium", "large")
    }
    for method, quality in names.items():
        assert run("reconstruct", "bits.npy", "-o", "same.npy", "-m", method)[0] == 0
        expected = pretrained(SERVED, quality).reconstruct(bits)
        np.testing.assert_array_equal(np.load("same.npy"), expected)


def test_reconstruct_says_what_it_takes_instead_and_why_and_how_to_train(run, pictures):
    bits = expose(pictures, OTHER)
    status, said = run("reconstruct", "bits.npy", "-o", "out.npy")
    assert status == 0
    assert "noniterative-tv" in said
    assert "there is no trained network for 400 bits per pixel" in said
    assert said.endswith(": jotlight train --sensor bits.npy -o model.safetensors\n")
    assert f"by {DEFAULT_ELSEWHERE} in" in said
    expected = METHODS["noniterative-tv"].run(bits, OTHER)
    np.testing.assert_array_equal(np.load("out.npy"), expected)


def test_reconstruct_by_the_network_fails_where_there_is_none(run, pictures, tmp_path):
    expose(pictures, OTHER)
    status, said = run("reconstruct", "bits.npy", "-o", "out.npy", "-m", "network-two-layer")
    assert status == 1
    assert said.startswith(
        f"error: {unsupported_reason(OTHER, 'two-layer')}; train one for this capture"
    )
    assert said.endswith(": jotlight train --sensor bits.npy -o model.safetensors\n")
    assert not (tmp_path / "out.npy").exists()


def test_a_model_of_ones_own_comes_first_and_nothing_is_said_of_others(run, pictures):
    for sensor in (SERVED, OTHER):
        bits = expose(pictures, sensor)
        network = jl.Network.initial(sensor, sigma=1.0)
        network.save("own.safetensors")
        words = ["reconstruct", "bits.npy", "-o", "out.npy", "--model", "own.safetensors"]
        status, said = run(*words)
        assert status == 0
        assert "trained network" not in said
        np.testing.assert_array_equal(np.load("out.npy"), network.reconstruct(bits))


def test_an_inverse_asks_for_the_non_iterative_method(run, pictures):
    bits = expose(pictures, SERVED)
    words = ["reconstruct", "bits.npy", "-o", "out.npy", "--inverse", "algebraic"]
    status, said = run(*words)
    assert status == 0
    assert f"by {DEFAULT_ELSEWHERE} in" in said
    expected = METHODS["noniterative-tv"].run(bits, SERVED, inverse="algebraic")
    np.testing.assert_array_equal(np.load("out.npy"), expected)


def test_options_that_change_the_sensor_decide_whether_there_is_a_network(run, pictures):
    expose(pictures, SERVED)
    words = ["reconstruct", "bits.npy", "-o", "out.npy", "--gain", 8]
    status, said = run(*words)
    assert status == 0
    assert "by network, medium in" in said
    status, said = run(*words, "-m", "network-two-layer")
    assert status == 1
    assert "0.5 detections per jot" in said


def test_counts_are_reconstructed_by_the_network_too(run, pictures):
    counts = expose(pictures, SERVED).counts(4)
    np.save("counts.npy", counts)
    for words in (["-t", 16], ["-k", 4]):
        status, said = run("reconstruct", "counts.npy", "-o", "out.npy", *words)
        assert status == 0
        assert "by network, medium in" in said
        expected = pretrained(SERVED).reconstruct(counts, SERVED)
        np.testing.assert_array_equal(np.load("out.npy"), expected)


def test_compare_has_the_learned_network_where_there_is_one(run, pictures):
    status, said = run("compare", pictures / "0.png", "-k", 2, "-t", 4)
    assert status == 0
    assert "network, learned" in said
    assert "network, initial" in said
    assert "Without the trained network" not in said


def test_compare_leaves_the_learned_network_out_where_there_is_none_and_says_so(run, pictures):
    status, said = run("compare", pictures / "0.png", "-k", 2, "-t", 3)
    assert status == 0
    assert "network, learned" not in said
    assert "network, medium" in said
    status, said = run("compare", pictures / "0.png", "-k", 2, "-t", 100)
    assert status == 0
    assert "network, medium" not in said
    assert "network, initial" in said
    assert "Without the trained network: there is no trained network for 400 bits" in said
    status, said = run("compare", pictures / "0.png", "-k", 2, "-t", 3, "-m", "mle")
    assert status == 0
    assert "trained network" not in said


def test_compare_by_the_network_alone_fails_where_there_is_none(run, pictures, tmp_path):
    words = ["compare", pictures / "0.png", "-k", 2, "-t", 3, "-m", "mle,network-two-layer"]
    status, said = run(*words)
    assert status == 1
    assert said.startswith("error: network-two-layer: there is no trained network for 12 bits")
    assert not (tmp_path / "0-compare.png").exists()


def test_demo_shows_the_learned_network(run):
    status, said = run("demo", "--photo", "coins")
    assert status == 0
    assert "network, learned" in said


DARK = np.full((96, 96), 0.3, np.float32)
DARK[::5] = 2.0
DARK[::5, ::2] = np.float32(0.05)

# The sensors that have none, and the reason.
WITHOUT = {
    "30 bits per pixel, only for 9, 16": jl.Sensor(frames=30),
    "the threshold 2, only for 1": jl.Sensor(oversampling=4, threshold=2),
    "0.5 detections per jot": jl.Sensor(oversampling=4, gain=8.0),
    "0.3333 detections per jot": jl.Sensor(oversampling=4, gain=16 / 3),
    "0.6667 detections per jot": jl.Sensor(oversampling=4, efficiency=2 / 3),
    "the cubic kernel, only for the box": jl.Sensor(oversampling=4, kernel="cubic"),
    "the largest intensity 2, only for 1": jl.Sensor(oversampling=4, max_intensity=2.0),
    "the largest intensity 1.33333": jl.Sensor(oversampling=4, max_intensity=4 / 3),
    "dark counts of 0.2": jl.Sensor(oversampling=4, dark_counts=0.2),
    "dark counts of 0.3": jl.Sensor(oversampling=4, dark_counts=DARK),
    "2 bits per pixel": jl.Sensor(
        frames=2, threshold=3, gain=10, efficiency=0.7, max_intensity=0.5, dark_counts=0.1
    ),
}


@pytest.mark.parametrize(("reason", "sensor"), WITHOUT.items(), ids=WITHOUT)
def test_a_sensor_without_a_network_gets_the_reason_and_a_command_that_makes_one(
    run, pictures, reason, sensor
):
    with pytest.raises(ValueError, match="there is no trained network for") as caught:
        pretrained(sensor, "two-layer")
    message = str(caught.value)
    assert unsupported_message(sensor, "two-layer") == message
    assert reason in message
    words = shlex.split(message[message.index("jotlight train ") :])[1:]
    words[words.index("FOLDER_OF_PHOTOGRAPHS")] = str(pictures)
    small = ["--steps", 1, "--patch", 24, "--batch", 2, "--optimizer", "adam"]
    status, said = run(*words, *small)
    assert status == 0, said
    side = 96 if sensor.oversampling == 4 else 24
    jl.save(sensor.expose(read_image(pictures / "0.png"), rng=0), "bits.npy")
    assert jl.open("bits.npy").shape[1] == side
    status, said = run("reconstruct", "bits.npy", "-o", "out.npy", "--model", "model.safetensors")
    assert status == 0, said
    assert np.isfinite(np.load("out.npy")).all()
