"""`jotlight film`: windows of frames, with and without motion."""

import errno
import json
from functools import partial

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from folders import file_names
from jotlight.cli.reconstruction import records
from jotlight.cli.terminal import console
from jotlight.errors import hide_warnings
from jotlight.evaluation.methods import METHODS
from jotlight.motion.films.estimates import estimate_film
from jotlight.motion.films.film import film
from servers import http_server

SENSOR = jl.Sensor(frames=40, gain=10.0, max_intensity=14.0)
SCENE = np.linspace(0.2, 12, 24 * 30).reshape(24, 30)


@pytest.fixture
def capture(tmp_path):
    bits = SENSOR.expose(SCENE, rng=0)
    jl.save(bits, tmp_path / "known.npy")
    return bits


@pytest.mark.parametrize("method", ["mle", "noniterative-gaussian"])
def test_a_film_has_the_estimate_of_each_window(run, capture, tmp_path, method):
    arguments = ["film", "known.npy", "-m", method, "--window", 16, "--step", 10]
    status, output = run(*arguments, "-o", "film.npy", "--units", "photons")
    assert status == 0
    assert "3 images of 24 x 30 from 16 frames each" in output
    assert "4 frames at the end lie in no window" in output
    found = np.load(tmp_path / "film.npy")
    assert run(*arguments, "-o", "film.tif", "--units", "photons")[0] == 0
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "film.tif"), found)
    function = METHODS[method].run
    for number in range(3):
        part = capture[10 * number : 10 * number + 16]
        expected = function(part, part.sensor) * np.float32(0.25)
        np.testing.assert_array_equal(found[number], expected)
    status, output = run(*arguments, "-o", "film")
    assert status == 0
    assert file_names(tmp_path / "film") == ["00000.png", "00001.png", "00002.png"]
    status, output = run(*arguments, "-o", "film.gif", "--fps", 5)
    assert status == 0
    with Image.open(tmp_path / "film.gif") as animation:
        assert (animation.n_frames, animation.size, animation.info["duration"]) == (
            3,
            (30, 24),
            200,
        )


@pytest.mark.filterwarnings("always:.*brighter than the largest intensity")
def test_pixels_brighter_than_the_limit_are_reported_once(run, tmp_path, monkeypatch):
    """Their number differs in each image."""
    monkeypatch.setattr(console, "shown_warnings", set())
    sensor = jl.Sensor(frames=1200)
    scene = np.full((24, 30), 0.3)
    scene[4:16, 5:8] = 1.65
    jl.save(sensor.expose(scene, rng=0), tmp_path / "stars.npy")
    status, output = run("film", "stars.npy", "-m", "mle", "--window", 400, "-o", "film.npy")
    assert status == 0
    assert output.count("pixels are brighter than the largest intensity, 1, which clips") == 1
    assert "saturate only at 6.68; --max-intensity 6.68 lets them be brighter" in output


@pytest.mark.filterwarnings("always")
def test_images_that_are_brighter_than_the_white_of_the_film_are_reported(run, tmp_path):
    bits = SENSOR.expose(SCENE / 20, rng=0).to_array()
    # Neither the first, nor the middle, nor the last window.
    bits[8:16] = SENSOR.expose(SCENE, rng=1).to_array()[8:16]
    jl.save(jl.Bits.from_array(bits, SENSOR), "flash.npy")
    arguments = ["film", "flash.npy", "-m", "mle", "--window", 8, "--step", 8]
    status, output = run(*arguments, "-o", "film")
    assert status == 0, output
    assert "of the pixels of image 1 are brighter than white, " in output
    assert "; --white " in output
    for name, options in (("chosen", ["--white", 2]), ("film.npy", [])):
        assert "brighter than white" not in run(*arguments, "-o", name, *options)[1]


@pytest.mark.filterwarnings("always")
def test_a_few_pixels_brighter_than_the_white_of_the_film_are_ordinary(run):
    bits = SENSOR.expose(SCENE / 20, rng=0).to_array()
    bits[8:16, 0] = True  # 1 of 24 rows, in one window
    jl.save(jl.Bits.from_array(bits, SENSOR), "ordinary.npy")
    status, output = run("film", "ordinary.npy", "-m", "mle", "--window", 8, "-o", "film")
    assert status == 0, output
    assert "brighter than white" not in output


@pytest.mark.filterwarnings("ignore:.*brighter than the largest intensity")
def test_images_of_counts_are_filmed(run, capture, tmp_path):
    counts = capture.to_array().reshape(10, 4, 24, 30).sum(axis=1).astype(np.uint16)
    np.save("counts.npy", counts)
    arguments = ["-m", "mle", "--window", 3, "--step", 2, "--max-intensity", 1]
    status, output = run("film", "counts.npy", "-o", "film.npy", *arguments, "--frames", 40)
    assert status == 0
    found = np.load(tmp_path / "film.npy")
    assert len(found) == 4
    for number in range(4):
        expected = jl.mle(counts[2 * number : 2 * number + 3].sum(axis=0), jl.Sensor(frames=12))
        np.testing.assert_array_equal(found[number], expected)
    display = ["--frames", 40, "--curve", "linear", "--white", 0.5]
    status, output = run("film", "counts.npy", "-o", "film.gif", *arguments, *display)
    assert status == 0
    assert "(linear curve, white at 0.5)" in output
    with Image.open(tmp_path / "film.gif") as animation:
        animation.seek(3)
        levels = np.asarray(animation.convert("L")) / 255
    np.testing.assert_allclose(levels, np.minimum(found[3] / 0.5, 1), atol=0.5001 / 255)
    status, output = run("film", "counts.npy", "-o", "b.npy", *arguments, "--frames", 42)
    assert status == 1
    assert "frames: expected a multiple of the 10 images of counts, because" in output
    assert "got 42; if each image has 42 frames, pass --frames 420" in output


def test_messages_about_images_of_counts_propose_what_to_write(run, capture):
    counts = capture.to_array().reshape(10, 4, 24, 30).sum(axis=1).astype(np.uint16)
    np.save("counts.npy", counts)

    def film_of(window, frames):
        words = ["-o", "a.npy", "-m", "mle", "--window", window, "--frames", frames]
        status, output = run("film", "counts.npy", *words)
        return output if status == 0 else output.removeprefix("error: ")

    assert "from 3 images of counts (12 frames) each" in film_of(3, 40)
    assert "; 1 image of counts (4 frames) at the end lies in no window" in film_of(3, 40)
    assert "; 2 images of counts (8 frames) at the end lie in no window" in film_of(4, 40)
    expected = "window: expected 1 to the capture's 10 images of counts, got 12"
    assert film_of(12, 40).startswith(f"{expected}; for 12 frames, 4 in each image, write --window")
    assert film_of(12, 50).splitlines() == [expected]
    found = film_of(3, 10)
    assert "counts.npy: expected counts from 0 to 1, the trials of each image, got 0 to" in found
    assert found.endswith("; --frames states the frames of all images together\n")


@pytest.mark.parametrize("described", [True, False])
def test_a_folder_may_have_the_name_of_the_capture(run, capture, tmp_path, described):
    description = tmp_path / "known.json"
    if not described:
        description.unlink()
    before = description.read_bytes() if described else None
    arguments = ["film", "known.npy", "--bits", "--window", 8, "-m", "mle"]
    status, output = run(*arguments, "-o", "known")
    assert status == 0, output
    assert (description.read_bytes() if description.exists() else None) == before
    status, output = run("info", "known.npy", "--bits")
    assert status == 0
    assert "is not used" not in output
    assert "known.npy" in run("info", "known")[1]  # the origin of the images


@pytest.mark.slow
def test_each_image_is_merged_along_the_motion(run, moving, tmp_path):
    arguments = ["film", "moving.npy", "--motion", "--window", 24, "--step", 12, "-m", "mle"]
    status, output = run(*arguments, "-o", "film.npy")
    assert status == 0, output
    assert "3 images of 48 x 64 from 24 frames each" in output
    found, images = np.load(tmp_path / "film.npy"), list(film(moving, window=24, step=12))
    for image, expected in zip(found, images, strict=True):
        np.testing.assert_array_equal(image, jl.mle(expected.merged))
    fresh = sum(not image.is_carried for image in images)
    assert f"estimated anew for {fresh} image" in output
    assert fresh == len(images)
    assert "carried" not in output
    accepted = [image.merged.acceptance.mean() for image in images]
    assert f"; {np.mean(accepted):.1%} of the bits agree and are used, and " in output
    assert f"and {min(accepted):.1%} or more of each image" in output
    assert run(*arguments, "-o", "film.gif", "--motion-model", "none")[0] == 0


@pytest.mark.filterwarnings("always")
@pytest.mark.slow
def test_a_warning_about_short_windows_is_about_some_images(run, moving):
    arguments = ["film", "moving.npy", "--motion", "--window", 6, "--step", 1, "-m", "mle"]
    status, output = run(*arguments, "-o", "film.npy")
    assert status == 0, output
    warning = "to estimate a motion, got 6; the scene is assumed to stand"
    assert f"{warning} still (in at least one image)" in output
    with hide_warnings():
        images = list(film(moving, window=6, step=1))
    models = {image.motion.model for image in images}
    assert models > {"none"}
    carried = sum(image.is_carried for image in images)
    assert f", and carried to {carried} others;" in output
    assert f"estimated anew for {len(images) - carried} images" in output


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "settings"),
    [
        (["--causal"], {"causal": True}),
        (["--causal", "--no-memory"], {"causal": True, "memory": False}),
        (["--memory"], {"memory": True}),
    ],
)
def test_images_can_use_only_earlier_frames_and_remember(run, moving, tmp_path, options, settings):
    arguments = ["film", "moving.npy", "--motion", "--window", 24, "--step", 8, "-m", "mle"]
    more = ["-o", "film.npy", "--motion-model", "affine"]
    status, output = run(*arguments, *more, *options)
    assert status == 0, output
    remembers = "--no-memory" not in options
    assert ("from 24 frames each and from those before that agree" in output) == remembers
    expected = list(film(moving, window=24, step=8, model="affine", **settings))
    assert (max(image.merged.trials.max() for image in expected) > 24) == remembers
    for image, other in zip(np.load(tmp_path / "film.npy"), expected, strict=True):
        np.testing.assert_array_equal(image, jl.mle(other.merged))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:window. the film network")
def test_the_film_network_reads_each_last_image(run, moving, tmp_path):
    arguments = ["film", "moving.npy", "--motion", "--recurrent", "--causal", "--window", 24]
    status, output = run(*arguments, "--step", 8, "-o", "film.npy", "--motion-model", "affine")
    assert status == 0, output
    assert "by network, film in" in output
    images = film(moving, window=24, step=8, model="affine", causal=True)
    for image, other in zip(np.load(tmp_path / "film.npy"), estimate_film(images), strict=True):
        np.testing.assert_array_equal(image, other)
    status, output = run(*arguments, "-o", "film.npy", "-m", "mle")
    assert status == 1
    assert "recurrent: the film network is a method of its own; leave out --method" in output


@pytest.mark.slow
def test_windows_without_overlap_remember_nothing(run, moving):
    status, output = run(
        *["film", "moving.npy", "--motion", "--causal", "--window", 16, "--step", 20, "-m", "mle"],
        *["-o", "film.npy", "--motion-model", "affine"],
    )
    assert status == 0, output
    assert "those before" not in output


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["-o", "a.npy", "--window", 41], "1 to the capture's 40 frames, got 41"),
        (["-o", "a.npy", "--window", 4, "--frames", 4], "--frame-range selects"),
        (["-o", "a.npy", "--window", 4, "--step", 0], "1 frame or more"),
        (["-o", "a.gif", "--window", 4, "--depth", 16], "choose .tif or .npy for floats"),
        (["-o", "a", "--window", 4, "--depth", 12], "got 12 for .png"),
        (
            ["-o", "a.npy", "--window", 8, "--step", 6, "--motion", "--memory"],
            "at most 4 for windows of 8, got 6; pass --step 4 or less, or leave out --memory",
        ),
        (["-o", "a.avi", "--window", 4], "new folder of .png"),
        (["-o", "a", "--window", 4, "--units", "photons"], "are for floats"),
        (["-o", "a.npy", "--window", 4, "--units", "lux"], "one of intensity, photons"),
        (["-o", "a.npy", "--window", 4, "--curve", "log"], "not for the floats of a.npy"),
        (["-o", "a.tif", "--window", 4, "--white", 1], "not for the floats of a.tif"),
        (["-o", "a", "--window", 4, "--white", 0], "white: expected a finite intensity above 0"),
        (["-o", "a.gif", "--window", 4, "--fps", -1], "fps: expected 0.01 to 10000 images per"),
        (["-o", "a.tif", "--window", 4, "--fps", 10], "fps: is for .mp4 and .gif; a.tif has no"),
        (["-o", "a", "--window", 4, "--fps", 10], "fps: is for .mp4 and .gif; a has no place"),
        (["-o", "a.gif", "--window", 4, "--fps", 60], "up to 50 images per second"),
        (["-o", "a", "--window", 4, "--depth", 12], "expected 8"),
        (["-o", "a", "--window", 4, "--motion-model", "affine"], "add --motion"),
        (["-o", "a", "--window", 4, "--motion", "--motion-model", "rigid"], "expected one of auto"),
        (["-o", "a", "--window", 4, "--causal"], "causal: is for the motion of the scene; add"),
        (["-o", "a", "--window", 4, "--memory"], "memory: is for the motion of the scene; add"),
        (["-o", "a", "--window", 4, "--recurrent"], "recurrent: is for the motion of the scene"),
        (
            ["-o", "a", "--window", 16, "--motion", "--recurrent", "--upsample", 2],
            "recurrent: expected no --recurrent with --upsample 2",
        ),
        (
            ["-o", "a", "--window", 16, "--motion", "--memory", "--upsample", 2],
            "memory: expected no --memory with --upsample 2",
        ),
        (["-o", "a", "--window", 4, "--upsample", 2], "upsample: is for the motion of the scene"),
        (["-o", "known.npy", "--window", 4], "choose another name"),
    ],
)
def test_bad_input_gets_one_clear_line_and_leaves_no_files(
    run, capture, tmp_path, arguments, expected
):
    before = file_names(tmp_path)
    status, output = run("film", "known.npy", *arguments)
    assert status == 1
    [line] = output.splitlines()
    assert line.startswith("error: ")
    assert expected in line
    assert file_names(tmp_path) == before


@pytest.mark.parametrize("output", ["film", "film.npy"])
def test_a_disk_without_space_for_the_record_gets_no_film(
    run, capture, tmp_path, monkeypatch, output
):
    sizes = []
    write = records.write_file

    def write_little(file, text, limit=None):
        sizes.append(len(text))
        if limit is not None and len(text) > limit:
            raise OSError(errno.ENOSPC, "No space left on device", str(file))
        write(file, text)

    monkeypatch.setattr(records, "write_file", write_little)
    arguments = ["film", "known.npy", "-m", "mle", "--window", 16, "-o"]
    assert run(*arguments, "first.npy")[0] == 0
    reserved, used = sizes
    assert used < reserved
    before = file_names(tmp_path)
    monkeypatch.setattr(records, "write_file", partial(write_little, limit=used - 1))
    status, text = run(*arguments, output)
    assert (status, text) == (1, f"error: cannot write {output}: No space left on device\n")
    assert file_names(tmp_path) == before


def test_the_window_is_required(run, capture):
    status, output = run("film", "known.npy", "-o", "a.npy")
    assert status == 2
    assert "--window is required, as in `jotlight film" in output


def test_a_film_of_a_url_equals_that_of_the_file(run, tmp_path):
    pytest.importorskip("fsspec", reason="no URLs: pip install 'jotlight[dask]'")
    jl.save(jl.Sensor(frames=16).expose(np.full((6, 16), 0.5), rng=0), tmp_path / "b.npy")
    options = ("--window", 4, "-m", "mle")
    with http_server(tmp_path) as server:
        code, out = run("film", f"{server.url}/b.npy", "-o", "remote.npy", *options)
        assert code == 0, out
        code, out = run("film", f"{server.url}/none.npy", "-o", "c.npy", *options)
        assert (code, "there is no file" in out) == (1, True)
    assert run("film", "b.npy", "-o", "local.npy", *options)[0] == 0
    np.testing.assert_array_equal(np.load("remote.npy"), np.load("local.npy"))
    origin = json.loads((tmp_path / "remote.npy.json").read_text())["origin"]
    assert origin["capture"] == "b.npy"
