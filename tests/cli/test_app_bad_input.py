"""Input that simulate, reconstruct, compare, demo, and info refuse."""

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
        (["simulate", "cut.png", "-o", "a.npy"], "damaged or truncated"),
        (["reconstruct", "bits.npy", "-o", "a.gif"], "ends in .png"),
        (["reconstruct", "bits.npy", "-o", "a.jpg", "--depth", "16"], "16 for a .png"),
        (["reconstruct", "bits.npy", "-o", "bits.npy"], "another name"),
        (["reconstruct", "bits.npy", "-o", "nowhere/a.png"], "there is no folder"),
        (["reconstruct", "bits.npy", "-o", "a.png", "-m", "magic"], "expected one of mle"),
        (
            ["reconstruct", "bits.npy", "-o", "a.png", "-m", "mle", "-k", "7"],
            "multiples of the oversampling",
        ),
        (["reconstruct", "bits.npy", "-o", "a.png", "-m", "mle", "--inverse", "exact"], "inverse"),
        (["reconstruct", "pickle.npy", "-o", "a.png"], "Python objects"),
        (["reconstruct", "counts.npy", "-o", "a.png", "-m", "mle", "-t", "3"], "0 to K = 3"),
        (["compare", "photo.png", "-m", "mle,magic"], "expected one of mle"),
        (["compare", "photo.png", "-o", "a.gif"], "ends in .png"),
        (["compare", "photo.png", "-o", "photo.png"], "another name"),
        (["compare", "nan.npy", "-o", "a.png"], "finite"),
        (["demo", "--photo", "nobody"], "expected one of camera"),
        (["info", "none.npy"], "there is no file"),
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
