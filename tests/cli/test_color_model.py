"""Color networks of the user on the command line."""

import numpy as np
import pytest

import jotlight as jl

SCENE = jl.datasets.photograph("astronaut")[:128:4, 100:228:4].astype(np.float64)


@pytest.fixture
def network(tmp_path):
    found = jl.ColorNetwork.initial("small", rng=0)
    found.save(tmp_path / "color.safetensors")
    return found


def save_bits(folder, mosaic):
    sensor = jl.Sensor(frames=32, mosaic=mosaic)
    bits = sensor.expose(SCENE, rng=0, channel_axis=None if mosaic else -1)
    jl.save(bits, folder / "colors.npy")
    return bits, ["--mosaic", mosaic] if mosaic else []


@pytest.mark.parametrize("mosaic", ["RGGB", None])
def test_a_color_network_estimates_the_image(run, tmp_path, network, mosaic):
    bits, options = save_bits(tmp_path, mosaic)
    arguments = ["colors.npy", "-o", "image.npy", "--model", "color.safetensors", *options]
    status, output = run("reconstruct", *arguments)
    assert status == 0, output
    assert "32 x 32 x 3" in output
    assert "by network, own" in output
    np.testing.assert_array_equal(
        np.load(tmp_path / "image.npy"), jl.reconstruct(bits, method=network)
    )


def test_a_color_network_estimates_a_film(run, tmp_path, network):
    bits, options = save_bits(tmp_path, "RGGB")
    arguments = ["colors.npy", "-o", "film.npy", "--window", 16, "--model", "color.safetensors"]
    status, output = run("film", *arguments, *options)
    assert status == 0, output
    expected = [jl.reconstruct(bits[start : start + 16], method=network) for start in (0, 16)]
    np.testing.assert_array_equal(np.load(tmp_path / "film.npy"), expected)


def test_runs_over_windows_refuse_a_color_network(run, tmp_path, network):
    _, options = save_bits(tmp_path, "RGGB")
    arguments = ["colors.npy", "-o", "v.zarr", "--window", 16, "--model", "color.safetensors"]
    status, output = run("reconstruct", *arguments, *options)
    assert status == 1
    assert "a color network reconstructs each capture by itself" in output
