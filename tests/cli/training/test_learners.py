"""Deep networks on the command line, where PyTorch is not needed."""

import sys

import numpy as np
import pytest

import jotlight as jl

NETWORK = "net.safetensors"
DEEP = "--quality small, medium, large"
TWO_LAYER = "--quality two-layer"


@pytest.fixture
def networks(run):
    """Save a deep network and a K-conditioned one."""
    jl.Network.residual(jl.Sensor(oversampling=4), "small", rng=0).save("deep.safetensors")
    jl.Network.conditional("small", trials_range=(1, 64), rng=0).save("conditional.safetensors")


def lines_of(run, *arguments):
    status, output = run(*arguments)
    assert status == 0
    return [" ".join(line.split()) for line in output.splitlines()]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--precision", "bf16"], f"precision: is for {DEEP}, not for {TWO_LAYER}"),
        (["--quality", "medium", "--damping", 1], f"damping: is for {TWO_LAYER}"),
        (["--quality", "large", "--sigma", 1], f"sigma: is for {TWO_LAYER}"),
        (["--quality", "small", "--untied"], f"untied: is for {TWO_LAYER}"),
        (["--device", "cpu"], f"device: is for {DEEP}, not for {TWO_LAYER}"),
        (["--quality", "two-layer", "--learning-rate", 0.1], "learning-rate: is for adam"),
        (
            ["--bits-per-pixel", "1:256"],
            f"bits-per-pixel: a range is for {DEEP}, not for {TWO_LAYER}",
        ),
        (["--quality", "huge"], "one of two-layer, small, medium, large, got 'huge'"),
        (["--quality", "small", "--start", "deep.safetensors"], "leave out --quality"),
        (
            ["--start", "deep.safetensors", "--bits-per-pixel", "1:256"],
            "start: this network has its own range of bits per pixel; leave out --bits-per-pixel",
        ),
        (["--start", "deep.safetensors", "--sigma", 0.5], "its own filters; leave out --sigma"),
        (["--start", "deep.safetensors", "--untied"], "its own weights; leave out --untied"),
        (["--start", "deep.safetensors", "--damping", 1], f"damping: is for {TWO_LAYER}"),
        (
            ["--quality", "small", "--bits-per-pixel", "1:256", "--sensor", "bits.npy"],
            "bits-per-pixel: --sensor states it; leave out one of them",
        ),
    ],
)
def test_an_option_of_other_networks_is_refused(run, photo_folder, networks, arguments, expected):
    status, output = run("train", photo_folder, "-o", NETWORK, *arguments)
    assert status == 1
    assert expected in output
    assert len(output.splitlines()) == 1


def test_without_pytorch_the_error_names_the_extra(run, photo_folder, tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.startswith("jotlight.torch")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    status, output = run("train", photo_folder, "-o", NETWORK, "--quality", "small")
    assert status == 1
    assert "pip install 'jotlight[torch]'" in output
    assert not (tmp_path / NETWORK).exists()


def test_info_describes_a_deep_network(run, networks):
    lines = lines_of(run, "info", "deep.safetensors")
    assert "sensor Sensor(oversampling=4)" in lines
    assert "parameters 4,132" in lines
    assert "halo 8 pixels" in lines
    assert "2 0 2 12 x 1 x 6 x 6 12 x 13 -3 to 3" in lines
    assert "5 1 2 4 x 12 x 3 x 3 1 x 4 0 to 1" in lines


def test_info_describes_a_conditional_network(run, networks):
    lines = lines_of(run, "info", "conditional.safetensors")
    assert "sensor any of 1 trial per pixel or more, box kernel; trained for 1 to 64" in lines
    assert "1 6 x 1 x 1 x 11 x 11 1 x 150 0 to 1" in lines


@pytest.mark.parametrize("sensor", [{"oversampling": 4}, {"frames": 5, "gain": 2.0}])
def test_a_conditional_network_reconstructs_captures_of_any_sensor(run, networks, sensor):
    sensor = jl.Sensor(**sensor)
    bits = sensor.expose(jl.datasets.photograph("camera")[:64, :48], rng=0)
    jl.save(bits, "bits.npy")
    assert (
        run("reconstruct", "bits.npy", "-o", "out.npy", "--model", "conditional.safetensors")[0]
        == 0
    )
    expected = jl.Network.load("conditional.safetensors").reconstruct(bits)
    assert (np.load("out.npy") == expected).all()


def test_a_conditional_network_reaches_saturation_where_the_sensor_is_unknown(
    run, networks, tmp_path
):
    bits = jl.Sensor(frames=16).expose(np.full((16, 16), 2.0), rng=0)
    jl.save(bits, "bits.npy")
    (tmp_path / "bits.json").unlink()
    status, output = run(
        "reconstruct", "bits.npy", "-o", "o.npy", "--model", "conditional.safetensors"
    )
    assert status == 0
    assert "half a count from saturation" in output
    assert np.load("o.npy").max() > 1.5


def test_evaluate_uses_its_default_sensor_for_a_conditional_network(run, networks, photo_folder):
    lines = lines_of(run, "evaluate", photo_folder, "--model", "conditional.safetensors")
    assert lines[0] == "conditional.safetensors, 3 images, Sensor(oversampling=4)"
    lines = lines_of(
        run, "evaluate", photo_folder, "--model", "conditional.safetensors", "-k", 1, "-t", 9
    )
    assert lines[0] == "conditional.safetensors, 3 images, Sensor(frames=9)"
    lines = lines_of(run, "evaluate", photo_folder, "--model", "conditional.safetensors", "-k", 9)
    assert lines[0] == "conditional.safetensors, 3 images, Sensor(oversampling=9)"


def test_compare_accepts_a_network_file(run, networks, photo_folder, tmp_path):
    arguments = ["compare", photo_folder / "0.png", "-m", "mle", "-o", "figure.png"]
    lines = lines_of(run, *arguments, "--model", "deep.safetensors")
    assert [line.split(" ")[0] for line in lines[1:3]] == ["maximum", "deep.safetensors"]
    status, output = run(*arguments, "--model", "deep.safetensors", "-k", 3)
    assert status == 1
    assert "it is for Sensor(oversampling=4), got Sensor(oversampling=3)" in output
    assert (tmp_path / "figure.png").stat().st_size > 5000


def test_training_a_deep_network_in_the_engine_names_the_pytorch_function():
    network = jl.Network.residual(jl.Sensor(oversampling=4), "small", rng=0)
    with pytest.raises(ValueError, match=r"jotlight\.torch\.train"):
        jl.train(network, jl.datasets.uniform_scenes, steps=1)


def test_a_two_layer_network_is_trained_by_one_process(run, photo_folder, monkeypatch, tmp_path):
    monkeypatch.setenv("WORLD_SIZE", "2")
    status, output = run("train", photo_folder, "-o", NETWORK, "--bits-per-pixel", 16)
    assert status == 1
    assert "is trained by one process, which uses all cores: start the command without" in output
    assert not (tmp_path / NETWORK).exists()
