"""What the files of results state about how they were made."""

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
    options = read_note(tmp_path / "image.tif")["options"]
    assert options == {"mean_weight": pytest.approx(history.weight.mean(), rel=1e-4)}


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
