"""Files that hold the means of frames, times a scale, and photographs."""

import os
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from examples.arrays import random_frames
from jotlight.formats import open_capture
from jotlight.formats.frames.scaled import unscale
from jotlight.formats.writing import write_capture

DATA = Path(os.environ.get("JOTLIGHT_DATA", "missing")) / "real/swissspad2_bird"


def save_means(path, frames, scale=255):
    means = np.rint(frames.mean(0) * scale)
    Image.fromarray(means.astype(np.uint8 if scale < 256 else np.uint16)).save(path)


def test_an_image_of_means_opens_as_counts(tmp_path):
    frames = random_frames((16, 20, 30))
    for scale in (255, 65535):
        save_means(tmp_path / "mean.png", frames, scale)
        counts = jl.open(tmp_path / "mean.png", counts_scale=scale, trials=16)
        assert counts.dtype == np.int32
        np.testing.assert_array_equal(counts, frames.sum(0))


def test_a_folder_of_means_is_a_stack_that_states_its_trials(tmp_path):
    frames = random_frames((3, 8, 20, 30))
    for index, part in enumerate(frames):
        save_means(tmp_path / f"{index}.png", part)
    stack = unscale(open_capture(tmp_path), 255, 8)
    assert (len(stack), stack.trials, stack.total_trials) == (3, 8, 24)
    np.testing.assert_array_equal(stack.sum(), frames.sum((0, 1)))
    assert "means of 8 frames, times 255" in stack.provenance.notes


def test_a_numpy_array_with_a_scale_holds_counts(tmp_path):
    frames = random_frames((4, 2, 20, 30))
    np.save(tmp_path / "a.npy", np.rint(frames.mean(0) * 255).astype(np.uint8))
    with pytest.warns(jl.JotlightWarning, match="the sum of its 2 images"):
        counts = jl.open(tmp_path / "a.npy", counts_scale=255, trials=4)
    np.testing.assert_array_equal(counts, frames.sum((0, 1)))


@pytest.mark.parametrize("trials", [32, 64, 128])
def test_a_multiple_of_the_true_trials_is_warned_about(tmp_path, trials):
    save_means(tmp_path / "mean.png", random_frames((16, 20, 30)))
    with pytest.warns(jl.JotlightWarning, match=r"means of 16 explain all.*pass trials=16"):
        jl.open(tmp_path / "mean.png", counts_scale=255, trials=trials)


@pytest.mark.parametrize("ending", ["npy", "npz", "tif"])
def test_float_means_open_as_counts(tmp_path, ending):
    frames = random_frames((16, 20, 30))
    path, means = tmp_path / f"a.{ending}", frames.mean(0, dtype=np.float32)
    if ending == "tif":
        tifffile.imwrite(path, means)
    else:
        (np.save if ending == "npy" else np.savez)(path, means)
    np.testing.assert_array_equal(jl.open(path, counts_scale=1, trials=16), frames.sum(0))
    with pytest.raises(ValueError, match="16 explains all values"):
        jl.open(path, counts_scale=1)
    with pytest.raises(ValueError, match="expected multiples of 1 / 15"):
        jl.open(path, counts_scale=1, trials=15)
    with pytest.raises(ValueError, match="floats are an image of intensities; means"):
        jl.open(path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"counts_scale": 255}, "trials: mean.png: expected.*; 16 explains all values"),
        ({"counts_scale": 255, "trials": 7}, "mean.png: counts_scale: expected multiples of"),
        ({"counts_scale": 255, "trials": 171}, "trials: expected at most 170"),
        ({"counts_scale": 1, "trials": 16}, "counts_scale: .* only floats hold means"),
        ({"counts_scale": 255, "trials": 0}, "trials: expected at least 1, got 0"),
        ({"counts_scale": -1, "trials": 16}, "counts_scale: expected"),
        ({"counts_scale": np.nan, "trials": 16}, "counts_scale: expected"),
        ({"trials": 16}, "trials: states the frames of each mean, together with counts_scale"),
        ({"counts_scale": 255, "trials": 16, "counts": False}, "holds counts"),
    ],
)
def test_a_wrong_scale_is_refused(options, message, tmp_path):
    save_means(tmp_path / "mean.png", random_frames((16, 20, 30)))
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "mean.png", **options)


def test_bits_and_labeled_counts_have_no_scale(tmp_path):
    frames = random_frames((16, 20, 30))
    jl.save(jl.Bits.from_array(frames), tmp_path / "bits.npy")
    with pytest.raises(ValueError, match="bits"):
        jl.open(tmp_path / "bits.npy", counts_scale=255, trials=16)
    write_capture(frames.sum(0), tmp_path / "counts.tif", "tiff", trials=16)
    with pytest.raises(ValueError, match="states counts of 16 trials"):
        jl.open(tmp_path / "counts.tif", counts_scale=255, trials=16)


@pytest.mark.skipif(not DATA.is_dir(), reason="JOTLIGHT_DATA names no folder with the capture")
@pytest.mark.parametrize("trials", [4, 16, 64])
def test_the_means_of_a_real_capture_are_its_counts(trials):
    with np.load(DATA / "counts.npz") as expected:
        counts = jl.open(DATA / f"average{trials}.png", counts_scale=255, trials=trials)
        np.testing.assert_array_equal(counts, expected[f"k{trials}"])


@pytest.mark.parametrize("extension", ["jpg", "jpeg", "webp", "bmp", "gif"])
def test_a_photograph_is_no_capture(extension, tmp_path):
    Image.new("L", (20, 20)).save(tmp_path / f"photo.{extension}")
    with pytest.raises(ValueError, match=r"holds a photograph.*`jotlight simulate photo\."):
        jl.open(tmp_path / f"photo.{extension}")


def test_a_color_png_may_be_a_photograph(tmp_path):
    Image.new("RGB", (20, 20)).save(tmp_path / "photo.png")
    with pytest.raises(ValueError, match="if it is a photograph, `jotlight simulate`"):
        jl.open(tmp_path / "photo.png")


@pytest.mark.parametrize("channels", [3, 4])
def test_a_photograph_in_an_array_is_not_taken_for_bits(tmp_path, channels):
    path = tmp_path / "photo.npy"
    photo = np.random.default_rng(0).integers(0, 256, (20, 30, channels), np.uint8)
    np.save(path, photo)
    with pytest.raises(ValueError, match=r"color photograph, .*simulate.*--bits"):
        jl.open(path)
    for options in ({"counts": False}, {"unpacked": False}, {"width": 8 * channels}):
        assert jl.open(path, **options).shape == (20, 30, 8 * channels)
    np.testing.assert_array_equal(jl.open(path, counts=True), photo)
    jl.save(jl.Bits(photo), path)
    assert jl.open(path).shape == (20, 30, 8 * channels)


@pytest.mark.parametrize("path", ["photo.jpg", Path("capture.bin")])
def test_methods_say_how_to_open_a_path(path):
    with pytest.raises(TypeError, match=r"got the path '.*; pass jotlight\.open\(path\)"):
        jl.reconstruct(path)
