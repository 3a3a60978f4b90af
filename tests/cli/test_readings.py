"""The command line on files whose readings differ in their gain or threshold."""

import numpy as np
import pytest

import jotlight as jl


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = np.random.default_rng(0).uniform(0.1, 1, (40, 48))
    bracket = jl.Sensor(frames=12, gain=np.repeat([0.25, 1.0, 4.0], 4), max_intensity=8.0)
    jl.save(bracket.expose(scene, rng=0), "bracket.npy")
    threshold = np.where(np.indices((40, 48)).sum(axis=0) % 2, 1, 3)
    checkerboard = jl.Sensor(frames=12, gain=24.0, threshold=threshold)
    jl.save(checkerboard.expose(scene, rng=0), "map.npy")
    return tmp_path


@pytest.mark.parametrize("name", ["bracket", "map"])
def test_reconstruct_writes_the_estimates_of_the_library(run, files, name):
    for options, estimate in (
        (["--method", "mle"], jl.mle(jl.open(f"{name}.npy"))),
        (["--quality", "small"], jl.reconstruct(jl.open(f"{name}.npy"), quality="small")),
    ):
        status, output = run("reconstruct", f"{name}.npy", "-o", "a.tif", *options)
        assert status == 0, output
        assert "moves" not in output
        np.testing.assert_array_equal(jl.read_image("a.tif"), estimate)


def test_info_shows_the_values(run, files):
    assert "12 values, 0.25 to 4" in " ".join(run("info", "bracket.npy")[1].split())
    assert "40 x 48" in " ".join(run("info", "map.npy")[1].split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["film", "bracket.npy", "--window", 4], "12 frames without a repetition; jotlight.recon"),
        (["reconstruct", "map.npy", "--find-hot-jots"], "find-hot-jots: expected one threshold"),
        (["view", "bracket.npy"], "expected exposures that repeat in cycles"),
    ],
)
def test_what_needs_one_gain_and_threshold_says_so(run, files, arguments, message):
    output = ["-o", "a.tif"] if arguments[0] != "view" else []
    status, text = run(*arguments, *output)
    assert status == 1
    assert message in " ".join(text.split())


def test_a_film_of_a_map_of_thresholds_has_the_images_of_its_windows(run, files):
    assert run("film", "map.npy", "-o", "film.tif", "--window", 4)[0] == 0
    expected = [jl.reconstruct(jl.open("map.npy")[start : start + 4]) for start in (0, 4, 8)]
    np.testing.assert_allclose(jl.read_image("film.tif")[:3], expected, atol=1e-6)


def test_brackets_are_stated_on_the_command_line(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    jl.save_image("p.png", jl.datasets.photograph("camera")[::8, ::8])
    common = ["simulate", "p.png", "-o", "b.npy", "-k", 1]
    assert run(*common, "-t", 6, "--gain", "8,1,0.125")[0] == 0
    assert jl.open("b.npy").sensor == jl.Sensor(frames=6, gain=np.repeat([8, 1, 1 / 8], 2))
    assert run("reconstruct", "b.npy", "-o", "e.tif")[0] == 0
    # The same bits without a description need the option again.
    np.save("plain.npy", np.load("b.npy"))
    options = ["-t", 6, "--gain", "8,1,0.125", "--max-intensity", 1, "--method", "mle"]
    assert run("reconstruct", "plain.npy", "-o", "e.npy", *options)[0] == 0
    np.testing.assert_array_equal(np.load("e.npy"), jl.mle(jl.open("b.npy")))
    assert run(*common, "-t", 4, "--gain", 16, "-q", "1,4")[0] == 0
    assert jl.open("b.npy").sensor.threshold.tolist() == [1, 1, 4, 4]
    q = 1 + np.arange(64 * 64).reshape(64, 64) % 3
    np.save("q.npy", q)
    assert run(*common, "-t", 4, "--gain", 16, "-q", "q.npy")[0] == 0
    np.testing.assert_array_equal(jl.open("b.npy").sensor.threshold, q)


@pytest.mark.slow
def test_brackets_that_repeat_are_aligned_and_filmed(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    jl.save_image("p.png", jl.datasets.photograph("camera")[100:228, 150:278])
    common = ["simulate", "p.png", "-o", "b.npy", "-k", 1, "-t", 96, "--gain", "1,8,..."]
    status, text = run(*common, "--motion", "shake")
    assert status == 0, text
    bits = jl.open("b.npy")
    assert bits.sensor == jl.Sensor(frames=96, gain=np.tile([1.0, 8.0], 48))
    status, text = run("reconstruct", "b.npy", "-o", "e.tif")
    assert "moves" in text
    assert "--motion aligns its frames" in " ".join(text.split())
    status, text = run("reconstruct", "b.npy", "-o", "e.tif", "--motion")
    assert status == 0, text
    np.testing.assert_array_equal(jl.read_image("e.tif"), jl.reconstruct(jl.merge(bits)))
    options = ["--window", 48, "--step", 24]
    status, text = run("film", "b.npy", "-o", "f.npy", *options, "-m", "mle")
    assert status == 0, text
    np.testing.assert_array_equal(np.load("f.npy")[1], jl.mle(bits[24:72]))
    for more in ([], ["--recurrent", "--causal"]):
        status, text = run("film", "b.npy", "-o", "g.npy", *options, "--motion", *more)
        assert status == 0, text
        assert np.load("g.npy").shape == (3, *bits.shape[1:])
    status, text = run("film", "b.npy", "-o", "h.npy", "--window", 32, "--step", 15)
    assert status == 1
    assert "step: expected a multiple of 2" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-t", 5, "--gain", "8,1"], "expected a multiple of 2 frames in --frames, got --frames 5"),
        (["-t", 4, "--gain", "8,...,1"], "gain: expected a number, or several such as 64,8,1"),
        (["-t", 4, "--gain", "8,x"], "gain: expected a number, or several such as 64,8,1"),
        (["-t", 4, "-q", "1,1.5"], "threshold: expected a number, or several such as"),
        (["-t", 4, "-q", "0"], "threshold: expected a whole number from 1 to 65535"),
        (["-t", 4, "--gain", "8,-1"], "gain: expected a number from 1e-18"),
    ],
)
def test_bad_values_of_frames_are_refused(run, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    jl.save_image("p.png", np.full((8, 8), 0.5))
    status, text = run("simulate", "p.png", "-o", "b.npy", "-k", 1, *arguments)
    assert status == 1
    assert message in text
