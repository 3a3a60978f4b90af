"""Options of captures that all commands share: rows and columns."""

import json
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.images.io import read_image

REGION = ("--region", "3:11,5:22")


@pytest.fixture
def part(captures):
    return jl.open(captures[0])[:, 3:11, 5:22]


def test_an_image_and_a_film_show_the_region(run, captures, part):
    assert run("reconstruct", captures[0], "-o", "a.npy", "-m", "mle", *REGION)[0] == 0
    np.testing.assert_array_equal(np.load("a.npy"), jl.mle(part))
    film = ("film", captures[0], "-o", "f.npy", "-m", "mle", "--window", 32)
    assert run(*film, *REGION)[0] == 0
    expected = [jl.mle(window) for window in part.windows(32)]
    np.testing.assert_array_equal(np.load("f.npy"), expected)
    out = " ".join(run("info", "a.npy")[1].split())
    assert "provenance npy: rows 3:11 and columns 5:22 of 16 x 24" in out


def test_runs_over_captures_and_windows_show_the_region(run, captures, part):
    zarr = pytest.importorskip("zarr")
    base = ("reconstruct", captures[0], captures[1], "-m", "mle")
    assert run(*base, "-o", "{name}.tif", *REGION)[0] == 0
    np.testing.assert_array_equal(read_image("1.tif"), jl.mle(part))
    run_of = json.loads(Path("1.tif.json").read_text())["run"]
    assert "rows 3:11 and columns 5:22" in run_of["provenance"]["notes"][0]
    assert "0 made, 2 complete" in run(*base, "-o", "{name}.tif", "--region", "3:11,05:22")[1]
    assert run_of["bits"] == [64, 8, 17]
    code, err = run(*base, "-o", "{name}.tif", "--region", "3:11,5:21")
    assert code == 1
    assert "belongs to another run" in err
    video = ("reconstruct", captures[0], "-o", "v.zarr", "-m", "mle", "--window", 32)
    assert run(*video, *REGION)[0] == 0
    expected = [jl.mle(window) for window in part.windows(32)]
    np.testing.assert_array_equal(zarr.open_array("v.zarr", mode="r")[:], expected)


def test_the_region_lies_in_the_rotated_frames(run, captures):
    options = ("--frame-range", "8:40", "--rotate", 90)
    assert run("convert", captures[0], "-o", "c.npy", *options, *REGION)[0] == 0
    expected = np.rot90(np.asarray(jl.open(captures[0]))[8:40], axes=(1, 2))[:, 3:11, 5:22]
    assert expected.shape == (32, 8, 11)  # 16 columns are left after the rotation
    np.testing.assert_array_equal(np.asarray(jl.open("c.npy")), expected)


def test_images_of_counts_have_the_region(run, captures):
    counts = np.stack([part.counts() for part in jl.open(captures[0]).windows(8)])
    np.save("counts.npy", counts.astype(np.uint16))
    base = ("reconstruct", "counts.npy", "-o", "a.npy", "-m", "mle", "--frames", 64)
    assert run(*base, *REGION)[0] == 0
    sensor = jl.Sensor(frames=64, max_intensity=9.0)
    expected = jl.mle(counts.sum(axis=0)[3:11, 5:22], sensor)
    np.testing.assert_allclose(np.load("a.npy"), expected)


@pytest.mark.parametrize(
    ("region", "message"),
    [
        ("3:11", "region: expected rows and columns R0:R1,C0:C1 in whole numbers"),
        ("3:11:2,5:22", "such as 10:40,16:48, got '3:11:2,5:22'"),
        ("-3:11,5:22", "region: expected rows and columns"),
        ("20:30,:", "bits: no rows in 20:30 of 16"),
    ],
)
def test_wrong_regions_are_refused(run, captures, region, message):
    code, out = run("reconstruct", captures[0], "-o", "a.npy", f"--region={region}")
    assert code == 1
    assert message in out
    assert not Path("a.npy").exists()


def test_maps_must_have_the_size_of_the_region(run, captures):
    base = ("reconstruct", captures[0], "-o", "a.npy", "-m", "mle", *REGION, "--mask", "mask.npy")
    np.save("mask.npy", np.zeros((16, 24), bool))
    code, out = run(*base)
    assert code == 1
    assert "mask: expected one value per jot, shape (8, 17), got shape (16, 24)" in out
    np.save("mask.npy", np.zeros((8, 17), bool))
    assert run(*base)[0] == 0


def test_the_viewer_refuses_a_region(run, captures):
    pytest.importorskip("uvicorn")
    code, out = run("view", captures[0], *REGION)
    assert code == 1
    assert "region: is not for the viewer; `jotlight convert --region`" in out
