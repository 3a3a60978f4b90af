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
        (["film", "bracket.npy", "--window", 4], "the sensor has a gain for each frame"),
        (["reconstruct", "map.npy", "--find-hot-jots"], "find-hot-jots: expected one threshold"),
        (["view", "bracket.npy"], "expected one gain and one threshold"),
    ],
)
def test_what_needs_one_gain_and_threshold_says_so(run, files, arguments, message):
    output = ["-o", "a.tif"] if arguments[0] != "view" else []
    status, text = run(*arguments, *output)
    assert status == 1
    assert message in " ".join(text.split())
