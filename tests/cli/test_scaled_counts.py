"""Means of frames on the command line."""

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from examples.arrays import random_frames


@pytest.fixture
def counts(tmp_path):
    frames = random_frames((16, 24, 32))
    Image.fromarray(np.rint(frames.mean(0) * 255).astype(np.uint8)).save(tmp_path / "mean.png")
    return frames.sum(0)


@pytest.mark.parametrize(
    "options", [("--frames", "16"), ("--trials", "16"), ("--oversampling", "2", "--frames", "4")]
)
def test_means_are_reconstructed_with_a_stated_scale(options, run, counts):
    scale = ("--counts-scale", "255", "--method", "mle")
    status, output = run("reconstruct", "mean.png", *scale, *options, "-o", "a.npy")
    assert status == 0, output
    assert "means of 16 frames, times 255" in output
    oversampling = 2 if "--oversampling" in options else 1
    sensor = jl.Sensor(frames=16 // oversampling**2, oversampling=oversampling)
    maximum = np.load("a.npy").max()
    np.testing.assert_allclose(
        np.load("a.npy"), np.minimum(jl.mle(counts, sensor.replace(max_intensity=maximum)), maximum)
    )


def test_the_scale_is_proposed(run, counts):
    for options in ((), ("--frames", "16")):
        status, output = run("reconstruct", "mean.png", *options, "-o", "a.png")
        assert status == 1
        assert "--counts-scale 255 and --frames 16" in output


def test_means_are_converted_to_counts(run, counts):
    scale = ("--counts-scale", "255", "--trials", "16")
    assert run("convert", "mean.png", *scale, "-o", "a.tif")[0] == 0
    np.testing.assert_array_equal(jl.open("a.tif"), counts)
    status, output = run("info", "mean.png", *scale)
    assert status == 0
    assert "means of 16 frames, times 255" in output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--counts-scale", "255"), "16 explains all values"),
        (("--counts-scale", "255", "--frames", "15"), "expected multiples of 255 / 15"),
        (("--trials", "16"), "with --counts-scale"),
    ],
)
def test_a_wrong_scale_is_refused(options, message, run, counts):
    status, output = run("reconstruct", "mean.png", *options, "-o", "a.png")
    assert status == 1
    assert message in output


def test_a_photograph_belongs_to_simulate(run, tmp_path):
    Image.new("L", (20, 20)).save(tmp_path / "photo.jpg")
    status, output = run("reconstruct", "photo.jpg", "-o", "a.png")
    assert status == 1
    assert "holds a photograph" in output
    assert "`jotlight simulate photo.jpg`" in output
