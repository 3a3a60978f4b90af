"""What the files of results state about how they were made."""

import json

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.files.checksums import file_checksum
from jotlight.images.io import read_note
from jotlight.networks.pretrained import CHANNELS_FILE, FOLDER


@pytest.mark.parametrize(
    ("method", "gray"), [([], ["large"]), (["--method", "held-out"], ["large", "medium"])]
)
def test_weights_of_an_aligned_mosaic_are_those_for_three_channels(run, tmp_path, method, gray):
    sensor = jl.Sensor(frames=4, mosaic="RGGB")
    jl.save(sensor.expose(np.full((16, 16, 3), 0.5), rng=0), tmp_path / "mosaic.npy")
    nodes = np.zeros((1, 2, 2, 1, 1), np.float32)
    nodes[0, 1] = 1.0
    information = np.ones((1, 2, 3, 1, 1), np.float32)
    times = np.array([0.0, 3.0])
    motion = jl.Motion(nodes, np.zeros((16, 16), np.uint8), times, 0.0, "affine", information)
    motion.save(tmp_path / "motion.safetensors")
    arguments = ["reconstruct", "mosaic.npy", "-o", "image.tif", *method]
    status, output = run(*arguments, "--motion", "--motion-file", "motion.safetensors")
    assert status == 0, output
    files = [CHANNELS_FILE, *(FOLDER / f"{name}.safetensors" for name in gray)]
    assert read_note(tmp_path / "image.tif")["weights_sha256"] == sorted(map(file_checksum, files))


def test_the_record_states_the_weight_that_the_method_found(run, tmp_path):
    bits = jl.Sensor(frames=16).expose(np.full((8, 8), 0.5), rng=0)
    jl.save(bits, tmp_path / "bits.npy")
    status, output = run("reconstruct", "bits.npy", "-o", "image.tif", "--method", "admm-tv")
    assert status == 0, output
    _, history = jl.admm_tv(bits, return_history=True)
    note = read_note(tmp_path / "image.tif")
    expected = {"mean_weight": pytest.approx(history.weight.mean(), rel=1e-4)}
    assert (note["options"], note["found"]) == ({}, expected)
    assert "found mean_weight=" in " ".join(run("info", "image.tif")[1].split())


def test_the_records_of_several_captures_and_of_films_state_the_weight(run, tmp_path):
    for name, light in (("a", 0.2), ("b", 0.8)):
        bits = jl.Sensor(frames=16).expose(np.full((8, 8), light), rng=0)
        jl.save(bits, tmp_path / f"{name}.npy")
    assert run("reconstruct", "a.npy", "b.npy", "-o", "{name}.tif", "--method", "admm-tv")[0] == 0
    assert run("film", "a.npy", "--window", 8, "-o", "film.npy", "--method", "admm-tv")[0] == 0
    for name in "ab":
        found = read_note(tmp_path / f"{name}.tif")["jotlight"]["found"]
        assert found == {"mean_weight": pytest.approx(weight_of(jl.open(f"{name}.npy")), rel=1e-4)}
        assert "found mean_weight=" in " ".join(run("info", f"{name}.tif")[1].split())
    expected = np.mean([weight_of(part) for part in jl.open("a.npy").windows(8)])
    found = json.loads((tmp_path / "film.npy.json").read_text())["origin"]["found"]
    assert found == {"mean_weight": pytest.approx(expected, rel=1e-4)}


def weight_of(bits):
    """Return the mean weight that ADMM finds."""
    return jl.admm_tv(bits, return_history=True)[1].weight.mean()


def test_the_records_of_mosaics_state_the_weight_of_all_planes(run, tmp_path):
    sensor = jl.Sensor(frames=16, mosaic="RGGB")
    for name in "ab":
        jl.save(sensor.expose(np.full((16, 16, 3), 0.5), rng=0), tmp_path / f"{name}.npy")
    arguments = ["--method", "admm-tv"]
    assert run("reconstruct", "a.npy", "-o", "one.tif", *arguments)[0] == 0
    assert run("reconstruct", "a.npy", "b.npy", "-o", "{name}.tif", *arguments)[0] == 0
    one = read_note(tmp_path / "one.tif")["found"]
    assert one["mean_weight"] > 0
    assert read_note(tmp_path / "a.tif")["jotlight"]["found"] == pytest.approx(one)


def test_the_record_and_the_message_name_the_file_of_a_network(run, tmp_path):
    sensor = jl.Sensor(frames=16)
    jl.save(sensor.expose(np.full((8, 8), 0.5), rng=0), tmp_path / "bits.npy")
    jl.Network.initial(sensor).save(tmp_path / "own.safetensors")
    status, output = run("reconstruct", "bits.npy", "-o", "image.tif", "--model", "own.safetensors")
    assert status == 0, output
    assert "by network, own (own.safetensors) in " in output
    note = read_note(tmp_path / "image.tif")
    assert note["model"] == "own.safetensors"
    assert note["weights_sha256"] == file_checksum(tmp_path / "own.safetensors")
    assert "own.safetensors" in run("info", "image.tif")[1]
