"""Paths as arguments of functions."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.verification import verify_capture
from jotlight.images.sets import read_image_set
from jotlight.paths import as_path, as_tensors_path

BITS = jl.Sensor(frames=16).expose(np.full((16, 16), 0.5), rng=0)

STILL = jl.Motion(
    np.zeros((1, 2, 2, 1, 1), np.float32),
    np.zeros((16, 16), np.uint8),
    np.arange(2.0),
    0.0,
    "affine",
    np.ones((1, 2, 3, 1, 1), np.float32),
)


def test_an_empty_text_is_no_path():
    assert as_path("a.npy", "open(path)").name == "a.npy"
    with pytest.raises(ValueError, match="path: expected the name of a file, as in open"):
        as_path("", "open(path)")


def test_the_current_folder_has_a_name(tmp_path, monkeypatch):
    folder = tmp_path / "frames"
    (folder / "below").mkdir(parents=True)
    for number in range(2):
        jl.save(np.eye(4, 5, dtype=int), folder / f"{number}.png")
    monkeypatch.chdir(folder)
    assert jl.open(".", unpacked=True).provenance.name == "frames"
    monkeypatch.chdir(folder / "below")
    assert jl.open("..", unpacked=True).provenance.name == "frames"
    assert as_path("../0.png", "open(path)").parts == ("..", "0.png")


@pytest.mark.slow
def test_every_function_takes_the_home_folder(tmp_path, monkeypatch):
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("USERPROFILE", str(home))
    monkeypatch.chdir(tmp_path)
    jl.save(BITS, "~/a.npy")
    assert len(jl.open("~/a.npy")) == len(jl.open("~/*.npy")[0]) == 16
    assert "readable" in verify_capture("~/a.npy")
    jl.save_image("~/photos.png", np.eye(4, 5))
    assert jl.read_image("~/photos.png").shape == (4, 5)
    jl.save_film("~/film.tif", [np.eye(4, 5)])
    (home / "photos").mkdir()
    jl.save_image("~/photos/b.png", np.eye(4, 5))
    assert read_image_set("~/photos")[0] == ["b.png"]
    calibration = jl.calibrate(np.full((16, 16), 3), frames=100)
    for value in (jl.Network.initial(jl.Sensor()), calibration, STILL):
        name = f"~/{type(value).__name__}.safetensors"
        value.save(name)
        assert repr(type(value).load(name)) == repr(value)
    jl.Network.initial(jl.Sensor()).export_onnx("~/model.onnx")
    scenes = np.full((4, 16, 16), 0.5)
    jl.train(jl.Network.initial(jl.Sensor()), scenes, steps=1, batch=2, rng=0, checkpoint="~/run")
    names = {"film.tif", "photos", "model.onnx", "run", "Network.safetensors"}
    assert names < {path.name for path in home.iterdir()}
    assert [path.name for path in tmp_path.iterdir()] == ["home"]


def test_a_file_whose_name_begins_with_a_tilde_is_itself(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    jl.save(BITS, "~no user has this name.npy")
    assert (tmp_path / "~no user has this name.npy").is_file()


def test_tensors_are_saved_by_the_ending_of_their_files():
    assert as_tensors_path("a.SAFETENSORS", "save(path)").name == "a.SAFETENSORS"
    calibration = jl.calibrate(np.full((16, 16), 3), frames=100)
    for value in (jl.Network.initial(jl.Sensor()), calibration, STILL):
        with pytest.raises(ValueError, match=r"a\.json: expected a name that ends in"):
            value.save("a.json")
