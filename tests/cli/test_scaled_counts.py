"""Means of frames on the command line."""

import warnings

import numpy as np
import pytest
import tifffile
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
        assert "--counts-scale 255 and --trials 16" in output


def test_means_that_are_taken_for_counts_of_255_frames_are_warned_about(run, counts, tmp_path):
    options = ("--frames", "255", "--method", "mle", "-o", "a.npy")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        status, output = run("reconstruct", "mean.png", *options)
    assert status == 0
    assert "warning: counts: the values look like means of 16 frames" in output
    levels = np.arange(24 * 32, dtype=np.uint8).reshape(24, 32)
    Image.fromarray(levels).save(tmp_path / "counts.png")
    assert run("reconstruct", "counts.png", *options)[0] == 0  # a warning would be an error


def test_a_black_and_white_image_is_proposed_as_bits(run, tmp_path):
    frame = random_frames((24, 32))
    Image.fromarray(frame.astype(np.uint8) * 255).save(tmp_path / "frame.png")
    status, output = run("reconstruct", "frame.png", "-o", "a.npy")
    assert status == 1
    assert "--unpacked" in output
    options = ("--unpacked", "--method", "mle", "--max-intensity", "5")
    assert run("reconstruct", "frame.png", *options, "-o", "a.npy")[0] == 0
    np.testing.assert_array_equal(np.load("a.npy") > 0, frame)


def save_hdf5(path, array):
    with pytest.importorskip("h5py").File(path, "w") as file:
        file["bits"] = array


@pytest.mark.parametrize(
    ("name", "save"), [("a.npy", np.save), ("a.tif", tifffile.imwrite), ("a.h5", save_hdf5)]
)
def test_a_stack_of_0_and_1_is_proposed_as_bits(run, name, save):
    frames = random_frames((16, 24, 32))
    save(name, frames.astype(np.uint8))
    options = ("--method", "mle", "-o", "image.npy")
    status, output = run("reconstruct", name, *options)
    assert status == 1
    assert "--unpacked" in output
    status, output = run("reconstruct", name, "--unpacked", *options)
    assert status == 0
    assert "Sensor(frames=16" in output


def test_the_proposal_for_a_folder_of_means_works(run, tmp_path):
    (tmp_path / "means").mkdir()
    frames = random_frames((3, 16, 24, 32))
    for index, part in enumerate(frames):
        image = Image.fromarray(np.rint(part.mean(0) * 255).astype(np.uint8))
        image.save(tmp_path / f"means/{index}.png")
    status, output = run("reconstruct", "means", "-o", "a.npy")
    assert status == 1
    assert "--counts-scale 255 and --trials 16" in output
    options = ("--counts-scale", "255", "--trials", "16")
    assert run("convert", "means", *options, "-o", "a.tif", "--sum")[0] == 0
    np.testing.assert_array_equal(jl.open("a.tif"), frames.sum((0, 1)))


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
