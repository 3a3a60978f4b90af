"""Periodic rates and hot jots on the command line."""

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.datasets import photograph

IMAGE = photograph("camera")[::2, ::2]


@pytest.fixture
def hot(tmp_path):
    """Return the hot jots of a capture."""
    hot = np.random.default_rng(0).random(IMAGE.shape) < 0.002
    sensor = jl.Sensor(frames=200, gain=10, dark_counts=np.where(hot, 2.0, 0.0))
    jl.save(jl.Bits(sensor.expose(IMAGE, rng=0).packed), tmp_path / "hot.npy")
    return hot


@pytest.fixture
def bayer(tmp_path):
    filters = np.tile([[0.5, 1.0], [1.0, 0.4]], (IMAGE.shape[0] // 2, IMAGE.shape[1] // 2))
    jl.save(jl.Sensor(frames=20).expose(IMAGE * filters, rng=0), tmp_path / "bayer.npy")


def test_hot_jots_are_reported_and_change_nothing(run, hot):
    for command in (("info",), ("reconstruct", "--method", "mle", "-o", "a.npy")):
        status, output = run(command[0], "hot.npy", *command[1:])
        assert status == 0, output
        assert " jots of 65536 look hot" in " ".join(output.split())
        assert "--find-hot-jots" in output
    bits = jl.open("hot.npy")
    sensor = jl.Sensor(frames=200, max_intensity=float(np.load("a.npy").max()))
    np.testing.assert_allclose(np.load("a.npy"), jl.mle(bits, sensor), rtol=1e-6)


def test_dark_counts_that_a_capture_does_not_show_are_reported(run, hot):
    np.save("own.npy", np.where(hot, 2.0, 0.0))
    np.save("flipped.npy", np.where(hot, 2.0, 0.0)[::-1])
    command = ("reconstruct", "hot.npy", "--method", "mle", "-o", "a.npy", "--dark-counts")
    status, output = run(*command, "flipped.npy")
    assert status == 0, output
    assert "jots with many dark counts do not show them in this capture" in output
    status, output = run(*command, "own.npy")
    assert "do not show them" not in output


@pytest.mark.filterwarnings("default")
def test_hot_jots_are_searched_with_the_stated_number_of_threads(run, hot, monkeypatch):
    count, found = engine.add_block_counts, []

    def noting(*arguments):
        found.append(arguments[-1])
        return count(*arguments)

    monkeypatch.setattr(engine, "add_block_counts", noting)
    options = ("--find-hot-jots", "--threads", "1", "--method", "mle", "-o", "a.npy")
    status, output = run("reconstruct", "hot.npy", *options)
    assert status == 0, output
    assert found[0] == 1


@pytest.mark.filterwarnings("default")
def test_hot_jots_are_treated_as_dead_with_the_option(run, hot):
    options = ("--find-hot-jots", "--method", "mle", "-o", "a.npy")
    status, output = run("reconstruct", "hot.npy", *options)
    assert status == 0, output
    found = jl.calibration.find_hot_jots(jl.open("hot.npy"))
    assert (found & hot).sum() == found.sum() > 0.8 * hot.sum()
    assert f"hot jots in the scene, which are treated as dead: {found.sum()}" in output
    assert "look hot" not in output
    sensor = jl.Sensor(frames=200, mask=found, max_intensity=float(np.load("a.npy").max()))
    with pytest.warns(jl.JotlightWarning, match="no valid bit"):
        expected = jl.mle(jl.open("hot.npy"), sensor)
    np.testing.assert_allclose(np.load("a.npy"), expected, rtol=1e-6)


@pytest.mark.filterwarnings("always")
def test_periodic_rates_are_reported(run, bayer):
    film = ("film", "--window", "5", "-m", "mle", "-o", "b.npy")
    for command in (("info",), ("reconstruct", "-o", "a.npy"), film):
        status, output = run(command[0], "bayer.npy", *command[1:])
        assert status == 0, output
        text = " ".join(output.split())
        assert text.count("the rates repeat every 2 x 2 jots") == 1
        assert "for example --mosaic RGGB for pixels of one jot" in text
        assert "look hot" not in text


@pytest.mark.filterwarnings("always")
def test_periodic_rates_of_a_film_of_counts_are_reported(run, bayer, tmp_path):
    bits = jl.open("bayer.npy")
    np.savez(tmp_path / "counts.npz", [bits[start : start + 5].counts() for start in (0, 5, 10)])
    options = ("--frames", "15", "--window", "1", "-m", "mle", "-o", "a.npy")
    status, output = run("film", "counts.npz", *options)
    assert status == 0, output
    assert "the rates repeat every 2 x 2 jots" in " ".join(output.split())


@pytest.mark.filterwarnings("default")
def test_the_option_is_not_recommended_after_its_use(run, tmp_path):
    light = np.full((32, 32), 0.005)
    light[16, 16:19] = 4.0, 0.6, 0.08  # each jot looks hot when the one before it is masked
    bits = jl.Sensor(frames=5000, max_intensity=9).expose(light, rng=0)
    jl.save(bits, tmp_path / "a.npy")
    first = jl.calibration.find_hot_jots(bits)
    assert jl.calibration.find_hot_jots(bits, mask=first).any()
    status, output = run("reconstruct", "a.npy", "--find-hot-jots", "-m", "mle", "-o", "b.npy")
    assert status == 0, output
    assert "hot jots in the scene, which are treated as dead" in output
    assert "look hot" not in output


@pytest.mark.filterwarnings("default")
def test_too_few_frames_to_find_hot_jots_are_reported(run, tmp_path):
    bits = jl.Sensor(frames=16).expose(np.full((32, 32), 0.5), rng=0)
    jl.save(bits, tmp_path / "few.npy")
    status, output = run("reconstruct", "few.npy", "--find-hot-jots", "-m", "mle", "-o", "b.npy")
    assert status == 0, output
    assert "16 frames are too few to find most hot jots" in " ".join(output.split())


@pytest.mark.filterwarnings("always")
@pytest.mark.parametrize("command", [("reconstruct",), ("film", "--window", "5")], ids=" ".join)
def test_a_removed_mosaic_is_reported_once(run, tmp_path, command):
    colors = np.stack([IMAGE, 0.6 * IMAGE, 0.3 * IMAGE], axis=-1)
    jl.save(jl.Sensor(frames=20, mosaic="RGGB").expose(colors, rng=0), tmp_path / "colors.npy")
    options = ("--mosaic", "none", "-m", "mle", "-o", "b.npy")
    status, output = run(command[0], "colors.npy", *command[1:], *options)
    assert status == 0, output
    text = " ".join(output.split())
    assert text.count("but no mosaic is used instead; leave out --mosaic unless") == 1
    assert "the rates repeat" not in text


def test_hot_jots_under_a_mosaic_are_not_searched(run, bayer):
    status, output = run("reconstruct", "bayer.npy", "--find-hot-jots", "-o", "a.npy")
    assert status == 1
    assert "find-hot-jots: expected jots that see like their neighbors" in output


def test_hot_jots_of_counted_pixels_are_not_searched(run, tmp_path):
    np.save(tmp_path / "a.npy", np.ones((8, 8), np.uint16))
    options = ("--frames", "4", "--oversampling", "2", "--find-hot-jots", "-o", "b.npy")
    status, output = run("reconstruct", "a.npy", *options)
    assert status == 1
    assert "counts of pixels of 2 x 2 jots" in output


def test_an_ordinary_capture_has_no_remarks(run, tmp_path):
    jl.save(jl.Sensor(frames=50).expose(IMAGE, rng=0), tmp_path / "a.npy")
    for command in (("info", "a.npy"), ("reconstruct", "a.npy", "-o", "b.npy")):
        status, output = run(*command)
        assert status == 0
        assert "hot" not in output
        assert "periodic" not in output
