"""Deep networks on the command line, where PyTorch is not needed."""

import sys

import numpy as np
import pytest

import jotlight as jl

NETWORK = "net.safetensors"
DEEP = "the networks small, medium, large"
TWO_LAYER = "the network two-layer"


@pytest.fixture
def networks(run):
    """A deep network and one that is told K, in files."""
    jl.Network.residual(jl.Sensor(oversampling=4), "small", rng=0).save("deep.safetensors")
    jl.Network.conditional("small", trials_range=(1, 64), rng=0).save("told.safetensors")


def lines(run, *words):
    status, said = run(*words)
    assert status == 0
    return [" ".join(line.split()) for line in said.splitlines()]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--network", "small", "--optimizer", "adam"], f"optimizer: is for {TWO_LAYER}, not for"),
        (["--network", "medium", "--damping", 1], f"damping: is for {TWO_LAYER}"),
        (["--network", "large", "--sigma", 1], f"sigma: is for {TWO_LAYER}"),
        (["--network", "small", "--untied"], f"untied: is for {TWO_LAYER}"),
        (["--device", "cpu"], f"device: is for {DEEP}, not for {TWO_LAYER}"),
        (["--network", "two-layer", "--learning-rate", 0.1], "learning-rate: is for adam"),
        (["--trials-range", "1:256"], f"trials-range: is for {DEEP}"),
        (["--network", "huge"], "one of two-layer, small, medium, large, got 'huge'"),
        (["--network", "small", "--start", "deep.safetensors"], "leave out --network"),
        (
            ["--start", "deep.safetensors", "--trials-range", "1:256"],
            "its own sigma, weights and trials range",
        ),
        (["--start", "deep.safetensors", "--damping", 1], f"damping: is for {TWO_LAYER}"),
        (
            ["--network", "small", "--trials-range", "1:256", "--sensor", "bits.npy"],
            "such a network is for any sensor; leave out --sensor",
        ),
    ],
)
def test_an_option_of_other_networks_is_refused(run, pictures, networks, words, expected):
    status, said = run("train", pictures, "-o", NETWORK, *words)
    assert status == 1
    assert expected in said
    assert len(said.splitlines()) == 1


def test_without_pytorch_the_extra_is_named(run, pictures, tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.startswith("jotlight.torch")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    status, said = run("train", pictures, "-o", NETWORK, "--network", "small")
    assert status == 1
    assert "pip install 'jotlight[torch]'" in said
    assert not (tmp_path / NETWORK).exists()


def test_info_tells_of_a_deep_network(run, networks):
    said = lines(run, "info", "deep.safetensors")
    assert "sensor Sensor(oversampling=4)" in said
    assert "parameters 4,132" in said
    assert "halo 8 pixels" in said
    assert "2 0 2 12 x 1 x 6 x 6 12 x 13 -3 to 3" in said
    assert "5 1 2 4 x 12 x 3 x 3 1 x 4 0 to 1" in said


def test_info_tells_of_a_network_that_is_told_its_bits(run, networks):
    said = lines(run, "info", "told.safetensors")
    assert "sensor any of 1 to 64 bits per pixel, box kernel" in said
    assert "1 6 x 1 x 1 x 11 x 11 1 x 150 0 to 1" in said


@pytest.mark.parametrize("sensor", [{"oversampling": 4}, {"frames": 5, "gain": 2.0}])
def test_a_network_that_is_told_its_bits_serves_captures_of_any_sensor(run, networks, sensor):
    sensor = jl.Sensor(**sensor)
    bits = sensor.expose(jl.datasets.photograph("camera")[:64, :48], rng=0)
    jl.save(bits, "bits.npy")
    assert run("reconstruct", "bits.npy", "-o", "out.npy", "--model", "told.safetensors")[0] == 0
    expected = jl.Network.load("told.safetensors").reconstruct(bits)
    assert (np.load("out.npy") == expected).all()


def test_a_network_that_is_told_its_bits_goes_on_to_saturation_where_no_sensor_is_told(
    run, networks, tmp_path
):
    bits = jl.Sensor(frames=16).expose(np.full((16, 16), 2.0), rng=0)
    jl.save(bits, "bits.npy")
    (tmp_path / "bits.json").unlink()
    status, said = run("reconstruct", "bits.npy", "-o", "o.npy", "--model", "told.safetensors")
    assert status == 0
    assert "half a count from saturation" in said
    assert np.load("o.npy").max() > 1.5


def test_evaluate_takes_its_usual_sensor_for_a_network_without_one(run, networks, pictures):
    said = lines(run, "evaluate", pictures, "--model", "told.safetensors")
    assert said[0] == "told.safetensors, 3 images, Sensor(oversampling=4)"
    said = lines(run, "evaluate", pictures, "--model", "told.safetensors", "-k", 1, "-t", 9)
    assert said[0] == "told.safetensors, 3 images, Sensor(frames=9)"
    status, said = run("evaluate", pictures, "--model", "told.safetensors", "-k", 9)
    assert status == 1
    assert "the network is for 1 to 64 bits per pixel, got 81" in said


def test_compare_takes_a_network_of_ones_own(run, networks, pictures, tmp_path):
    words = ["compare", pictures / "0.png", "-m", "mle", "-o", "figure.png"]
    said = lines(run, *words, "--model", "deep.safetensors")
    assert [line.split(" ")[0] for line in said[1:3]] == ["maximum", "deep.safetensors"]
    status, said = run(*words, "--model", "deep.safetensors", "-k", 3)
    assert status == 1
    assert "it is for Sensor(oversampling=4), got Sensor(oversampling=3)" in said
    assert (tmp_path / "figure.png").stat().st_size > 5000


def test_the_engine_sends_deep_networks_to_pytorch():
    network = jl.Network.residual(jl.Sensor(oversampling=4), "small", rng=0)
    with pytest.raises(ValueError, match=r"jotlight\.torch\.train"):
        jl.train(network, jl.datasets.uniform_scenes, steps=1)
