"""Messages name options on the command line and parameters in Python."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import jotlight as jl
from jotlight.images.io import read_note


@pytest.fixture
def capture(tmp_path):
    bits = jl.Sensor(frames=64).expose(np.full((8, 16), 0.5), rng=0)
    np.save(tmp_path / "capture.npy", bits.packed)
    np.save(tmp_path / "counts.npy", np.ones((3, 8, 8), int))
    (tmp_path / "raw.bin").write_bytes(bytes(100))
    scipy.io.savemat(tmp_path / "counts.mat", {"OUTPUT": np.full((8, 16, 4), 7, np.uint8)})
    np.save(tmp_path / "deep.npy", np.full((64, 64), 1000, np.uint16))
    return bits


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["capture.npy", "-t", 16], "take --frame-range 0:16, or --frames 64"),
        (["capture.npy", "-t", 80], "expected the sensor's 80 frames, got 64; take --frames 64"),
        (["counts.mat", "-m", "mle"], "got 7 to 7; --counts reads the numbers as counts"),
        (["raw.bin"], "pass --format: swissspad2"),
        (["capture.npy", "--frame-range", "100:200"], "no frames in 100:200 of 64"),
        (["counts.npy", "-t", 9, "--frame-range", "5:"], "no frames in 5: of 3"),
    ],
)
def test_advice_names_options(run, capture, arguments, expected):
    status, output = run("reconstruct", *arguments, "-o", "out.npy")
    assert status == 1
    [line] = output.splitlines()
    assert expected in line


def test_advice_on_images_names_options(run, capture):
    status, output = run("simulate", "deep.npy", "-o", "bits.npy")
    assert status == 1
    assert "state the level of intensity 1 with --white, such as" in output


def test_advice_in_python_names_parameters_with_their_options(capture, tmp_path):
    with pytest.raises(ValueError, match=r"bits\[:16\] \(--frame-range 0:16\), or sensor.replace"):
        jl.mle(capture, jl.Sensor(frames=16))
    with pytest.raises(ValueError, match=r"format= \(--format\)"):
        jl.open(tmp_path / "raw.bin")


def test_a_range_of_frames_is_printed_as_an_option(run, capture):
    arguments = ["reconstruct", "capture.npy", "-m", "mle", "-o", "out.npy"]
    status, output = run(*arguments, "--frame-range", "0:64:2")
    assert status == 0
    assert "npy: frames 0:64:2 of 64\n" in output
    status, output = run(*arguments, "--frame-range", "60:")
    assert "npy: frames 60:64 of 64\n" in output


def test_only_the_sum_of_several_images_is_reported(run, tmp_path):
    for number, warned in ((1, False), (2, True)):
        np.save("counts.npy", np.ones((number, 8, 8), int))
        status, output = run("reconstruct", "counts.npy", "-t", 16, "-m", "mle", "-o", "out.npy")
        assert status == 0
        assert ("the sum of a stack of" in output) == warned


def test_images_of_counts_that_are_aligned_are_not_summed(run):
    counts = jl.Sensor(frames=256).expose(np.full((24, 24), 0.5), rng=0).to_array()
    np.save("counts.npy", counts.reshape(32, 8, 24, 24).sum(1))
    for arguments in (
        ("reconstruct", "--motion", "-o", "a.tif"),
        ("film", "--window=8", "-o", "f.npy"),
    ):
        status, output = run(arguments[0], "counts.npy", "-t", 256, "-m", "mle", *arguments[1:])
        assert status == 0, output
        assert "the sum of a stack of" not in output
    assert "the sum of a stack of" not in str(read_note("a.tif")["provenance"])


@pytest.mark.parametrize("value", ["2.5", "-0.5", "16.25", "2.5e0", "2_0.5", "inf"])
def test_a_whole_number_is_not_rounded(run, tmp_path, value):
    np.save(tmp_path / "scene.npy", np.full((8, 8), 0.5))
    status, output = run("simulate", "scene.npy", "-o", "a.npy", f"--frames={value}")
    assert status == 2
    assert f"--frames: expected a whole number, got {value}." in output
    assert run("simulate", "scene.npy", "-o", "a.npy", "--frames=2.0")[0] == 0
    assert len(jl.open(tmp_path / "a.npy")) == 2


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_behind_the_standard_output_is_named(tmp_path):
    np.save(tmp_path / "a.npy", np.full((8, 8), 0.5))
    command = [sys.executable, "-m", "jotlight", "info", tmp_path / "a.npy"]
    # With this variable, Python has no text left to write when it ends.
    buffered = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, env=buffered
        )
    assert ended.returncode == 1
    assert ended.stderr.startswith("error: cannot write to the standard output: No space left")
