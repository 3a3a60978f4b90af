"""Input that simulate, reconstruct, compare, demo, and info refuse."""

import errno
import os

import numpy as np
import pytest

import jotlight as jl


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["simulate", "none.png", "-o", "a.npy"], "there is no image file none.png"),
        (["simulate", "photo.png", "-o", "a.npy", "-k", "0"], "oversampling: expected"),
        (["simulate", "photo.png", "-o", "a.npy", "-q", "0"], "threshold: expected"),
        (["simulate", "photo.png", "-o", "a.npy", "--gain", "-1"], "gain: expected"),
        (["simulate", "photo.png", "-o", "a.npy", "--kernel", "round"], "kernel: expected one of"),
        (["simulate", "photo.png", "-o", "a.tif"], "ends in .npy"),
        (["simulate", "photo.png", "-o", "nowhere/a.npy"], "there is no folder nowhere"),
        (["simulate", "photo.png", "-o", "photo.png/a.npy"], "cannot write"),
        (["simulate", "counts.npy", "-o", "a.npy"], "--white"),
        (["simulate", "text.png", "-o", "a.npy"], "no known format"),
        (["simulate", "cut.png", "-o", "a.npy"], "it is truncated"),
        (["reconstruct", "bits.npy", "-o", "a.gif"], "ends in .png"),
        (["reconstruct", "bits.npy", "-o", "a.jpg", "--depth", "16"], "16 for .png"),
        (["reconstruct", "bits.npy", "-o", "bits.npy"], "another name"),
        (["reconstruct", "bits.npy", "-o", "nowhere/a.png"], "there is no folder"),
        (["reconstruct", "bits.npy", "-o", "a.png", "-m", "magic"], "expected one of mle"),
        (
            ["reconstruct", "bits.npy", "-o", "a.png", "-m", "mle", "-k", "7"],
            "multiples of the oversampling",
        ),
        (["reconstruct", "bits.npy", "-o", "a.png", "-m", "mle", "--inverse", "exact"], "inverse"),
        (["reconstruct", "pickle.npy", "-o", "a.png"], "Python objects"),
        (
            ["reconstruct", "counts.npy", "-o", "a.png", "-m", "mle", "-t", "3"],
            "counts from 0 to 3",
        ),
        (["compare", "photo.png", "-m", "mle,magic"], "expected one of mle"),
        (["compare", "photo.png", "-o", "a.gif"], "ends in .png"),
        (["compare", "photo.png", "-o", "photo.png"], "another name"),
        (["compare", "nan.npy", "-o", "a.png"], "finite"),
        (["demo", "--photo", "nobody"], "expected one of camera"),
        (["simulate", "photo.png", "-o", "a.npy", "--efficiency", "40%"], "map, got '40%'"),
        (["info", "none.npy"], "there is no file"),
        (["info", "b*.npy"], "there is no file b*.npy; a pattern of several files is not taken"),
        (["film", "b*.npy", "-o", "a.npy", "--window", "1"], "name one; `jotlight reconstruct`"),
        (["calibrate", "b*.npy", "-o", "a.safetensors"], "name one; `jotlight reconstruct`"),
        (["view", "b*.npy"], "name one; `jotlight reconstruct`"),
        (["calibrate", "s3://a/b.npy", "-o", "a.safetensors"], "take a URL"),
        (["simulate", "*.png", "-o", "a.npy"], "not taken here: name one image"),
        (["compare", "*.png"], "not taken here: name one image"),
        (["evaluate", "*.png"], "not taken here: name the folder of the images"),
        (["train", "*.png", "-o", "a.safetensors"], "not taken here: name the folder of the"),
    ],
)
def test_bad_input_gets_one_clear_line_and_leaves_no_files(
    run, photo, tmp_path, arguments, expected
):
    jl.save(jl.Bits.from_array(np.ones((1, 8, 8), bool), jl.Sensor(oversampling=4)), "bits.npy")
    np.save("counts.npy", np.arange(64).reshape(8, 8))
    np.save("nan.npy", np.full((20, 20), np.nan))
    np.save("pickle.npy", np.array([{}, None], dtype=object))
    (tmp_path / "text.png").write_text("not an image")
    (tmp_path / "cut.png").write_bytes(photo.read_bytes()[:200])
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    status, output = run(*arguments)
    assert status == 1
    assert expected in output
    assert output.startswith("error: ")
    assert "Traceback" not in output
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
@pytest.mark.parametrize("options", [[], ["--format", "npy"]])
def test_a_stream_is_not_called_missing(run, options):
    os.mkfifo("pipe")
    status, output = run("convert", "pipe", "-o", "a.npy", *options)
    assert status == 1
    assert "error: pipe: is a stream; write it to a file first, or show it by `jotlight" in output
    status, output = run("convert", "missing", "-o", "a.npy", *options)
    assert (status, output) == (1, "error: there is no file missing\n")


def test_errors_of_the_system_name_the_file_and_have_no_number(run, photo, monkeypatch):
    def refuse(*args, **kwargs):
        raise PermissionError(errno.EACCES, "Permission denied", "locked.npy")

    monkeypatch.setattr("jotlight.cli.simulate.read_image", refuse)
    status, output = run("simulate", photo, "-o", "bits.npy")
    assert (status, output) == (1, "error: cannot access locked.npy: Permission denied\n")


def test_a_missing_output_folder_is_found_before_the_work_starts(run, photo, monkeypatch):
    def work(*args, **kwargs):
        raise AssertionError("the work has begun")

    monkeypatch.setattr(jl.Sensor, "expose", work)
    assert "there is no folder" in run("simulate", photo, "-o", "nowhere/bits.npy")[1]
    assert "there is no folder" in run("compare", photo, "-o", "nowhere/figure.png")[1]


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate", "same.npy", "-o", "same.npy"],
        ["simulate", "photo.png", "-o", "dead.npy", "--mask", "dead.npy", "-k", "1"],
        ["simulate", "photo.png", "-o", "dark.npy", "--dark-counts", "dark.npy", "-k", "1"],
        ["simulate", "photo.png", "-o", "./sub/../dead.npy", "--mask", "dead.npy", "-k", "1"],
        ["reconstruct", "bits.npy", "-o", "bits.npy", "-m", "mle"],
        ["reconstruct", "bits.npy", "-o", "bits.mask.npy", "-m", "mle"],
        ["reconstruct", "bits.npy", "-o", "link.npy", "-m", "mle"],
        ["compare", "photo.png", "-o", "photo.png", "-m", "mle"],
    ],
)
def test_a_file_that_is_read_is_never_overwritten(run, photo, tmp_path, arguments):
    dead = np.zeros((40, 49), bool)
    dead[0, 0] = True
    np.save("dead.npy", dead)
    np.save("dark.npy", np.full((40, 49), 0.1, np.float32))
    np.save("same.npy", np.full((20, 20), 0.5, np.float32))
    jl.save(jl.Sensor(mask=dead).expose(np.full((40, 49), 0.5), rng=0), "bits.npy")
    (tmp_path / "link.npy").symlink_to("bits.npy")
    (tmp_path / "sub").mkdir()
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    status, output = run(*arguments)
    assert status == 1
    assert "this file is read" in output
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before
