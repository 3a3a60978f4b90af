"""`jotlight simulate`."""

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile

import jotlight as jl
from folders import file_names, size_limit
from jotlight.formats.files.checksums import file_checksum
from jotlight.images.io import read_image, read_note


def test_simulate_and_reconstruct_write_what_the_python_interface_returns(run, photo, tmp_path):
    status, output = run("simulate", photo, "-o", "bits.npy", "-k", 3, "-t", 2, "--seed", 5)
    assert status == 0
    assert "2 frames of 120 x 147 jots" in output
    image = read_image(photo)
    sensor = jl.Sensor(oversampling=3, frames=2)
    bits = jl.open(tmp_path / "bits.npy")
    assert bits.sensor == sensor
    assert (bits.packed == sensor.expose(image, 5).packed).all()
    status, _ = run("reconstruct", "bits.npy", "-o", "out.npy", "--method", "mle")
    assert status == 0
    assert (np.load(tmp_path / "out.npy") == jl.mle(bits, sensor)).all()


@pytest.mark.parametrize("mosaic", [None, "RGGB"])
def test_an_image_brighter_than_the_stated_limit_is_reported(run, mosaic):
    shape = (16, 16) if mosaic is None else (16, 16, 3)
    scene = np.full(shape, 0.3, np.float32)
    np.save("white.npy", 1 / 0.3 * scene)
    scene[5, 7] = 2.9189
    np.save("star.npy", scene)
    options = ["-o", "bits.npy", "-t", 50, *(() if mosaic is None else ("--mosaic", mosaic))]
    _, output = run("simulate", "star.npy", *options)
    assert output.count("the photo reaches 2.92, and the bits see all of this light") == 1
    assert "states a largest intensity of 1, which clips estimates; --max-intensity 2.93" in output
    for arguments in (["star.npy", "--max-intensity", 2.93], ["white.npy"]):
        assert "the photo reaches" not in run("simulate", *arguments, *options)[1]


@pytest.mark.filterwarnings("ignore:.*brighter than the largest intensity")
@pytest.mark.parametrize("level", [0.9, 1.2])
def test_a_white_balance_does_not_move_the_stated_limit(run, level):
    """It multiplies estimates after they are clipped."""
    balance = [0.5, 1, 1.5]
    mosaic = {"pattern": ["RG", "GB"], "white_balance": balance}
    Path("mosaic.json").write_text(json.dumps(mosaic))
    np.save("scene.npy", np.full((16, 16, 3), level, np.float32))
    options = ["-o", "bits.npy", "-t", 500, "--mosaic", "mosaic.json"]
    output = run("simulate", "scene.npy", *options)[1]
    assert ("the photo reaches" in output) == (level > 1), output
    estimate = jl.reconstruct(jl.open("bits.npy"), method="mle").mean(axis=(0, 1))
    np.testing.assert_allclose(estimate / balance, min(level, 1), rtol=0.1)


def test_the_option_gray_converts_color_to_luma(run, color, tmp_path):
    assert run("simulate", color, "-o", "bits.npy", "--gray")[0] == 0
    assert jl.open(tmp_path / "bits.npy").shape == (1, 160, 196)


@pytest.mark.parametrize("dark_file", ["dark.npy", "dark.tif"])
def test_all_sensor_options_reach_the_sensor(run, photo, tmp_path, dark_file):
    rng = np.random.default_rng(0)
    dark = rng.random((80, 98)).astype(np.float32)
    dead = rng.random((80, 98)) < 0.1
    (np.save if dark_file.endswith(".npy") else tifffile.imwrite)(tmp_path / dark_file, dark)
    np.save(tmp_path / "dead.npy", dead)
    options = ["-k", 2, "-t", 3, "--gain", 6, "-q", 2, "--kernel", "cubic"]
    options += ["--efficiency", 0.5, "--max-intensity", 2]
    maps = ["--dark-counts", dark_file, "--mask", "dead.npy"]
    assert run("simulate", photo, "-o", "bits.npy", *options, *maps)[0] == 0
    assert jl.open(tmp_path / "bits.npy").sensor == jl.Sensor(
        oversampling=2, frames=3, gain=6, threshold=2, kernel="cubic", dark_counts=dark,
        efficiency=0.5, mask=dead, max_intensity=2,
    )  # fmt: skip


def test_simulating_again_without_a_mask_deletes_the_old_map(run, photo, tmp_path):
    np.save("dead.npy", np.zeros((40, 49), bool))
    masked = ["simulate", photo, "-o", "bits.npy", "-k", 1, "--mask", "dead.npy"]
    for arguments in (masked, masked[:-2], masked):
        assert run(*arguments)[0] == 0
        assert (tmp_path / "bits.mask.npy").exists() == ("--mask" in arguments)
        assert jl.open("bits.npy").sensor == jl.Sensor(
            mask=np.zeros((40, 49), bool) if "--mask" in arguments else None
        )


def test_simulate_does_not_delete_the_map_that_it_reads(run, tmp_path):
    np.save("scene.npy", np.full((20, 24), 0.5, np.float32))
    np.save("dark.npy", np.full((20, 24), 0.25, np.float32))
    arguments = ["simulate", "scene.npy", "-o", "a.npy", "-k", 1, "--dark-counts", "dark.npy"]
    assert run(*arguments)[0] == 0
    before = (tmp_path / "a.dark_counts.npy").read_bytes()
    status, output = run("simulate", "a.dark_counts.npy", "-o", "a.npy", "-k", 1)
    assert status == 1
    assert "this file is read" in output
    assert (tmp_path / "a.dark_counts.npy").read_bytes() == before


def test_a_failed_write_is_reported_and_leaves_no_files(run, photo, tmp_path):
    pytest.importorskip("resource")
    with size_limit(1 << 14):
        status, output = run("simulate", photo, "-o", "bits.npy", "-k", 1, "-t", 100)
    assert status == 1
    assert "cannot write bits.npy: File too large" in output
    assert file_names(tmp_path) == ["photo.png"]


@pytest.mark.parametrize("options", [[], ["--gray"]])
def test_the_bits_do_not_depend_on_the_parts_in_which_they_are_written(
    run, color, tmp_path, monkeypatch, options
):
    arguments = ["simulate", color, "-k", 2, "-t", 7, "--kernel", "cubic", *options]
    assert run(*arguments, "-o", "whole.npy")[0] == 0
    monkeypatch.setattr("jotlight.formats.npy.arrays._WRITTEN_BYTES", 10_000)
    assert run(*arguments, "-o", "parts.npy")[0] == 0
    assert (tmp_path / "parts.npy").read_bytes() == (tmp_path / "whole.npy").read_bytes()
    sensor = jl.Sensor(oversampling=2, frames=7, kernel="cubic")
    image = read_image(color, gray=bool(options))
    axis = None if options else -1
    bits = sensor.expose(image, 0, channel_axis=axis)
    np.testing.assert_array_equal(np.load("whole.npy"), bits.packed)


@pytest.mark.parametrize("motion", ["shake", "layers", "poses.csv"])
def test_moving_photographs_are_those_of_the_python_interface(run, photo, tmp_path, motion):
    poses = np.random.default_rng(0).normal(size=(5, 2)).cumsum(axis=0).round(2)
    (tmp_path / "poses.csv").write_text(
        "# rows, columns\n" + "\n".join(f"{a}, {b}" for a, b in poses)
    )
    options = ["--motion", motion, "--photons", 0.3, "-k", 1, "-t", 5, "--seed", 4]
    options += ["--truth", "truth.npy", *(["--foreground", photo] if motion == "layers" else [])]
    status, output = run("simulate", photo, "-o", "bits.npy", *options)
    assert status == 0, output
    scene = jl.datasets.moving(
        read_image(photo),
        poses if motion == "poses.csv" else motion,
        sensor=jl.Sensor(frames=5),
        foreground=read_image(photo) if motion == "layers" else None,
        photons=0.3,
        rng=4,
    )
    bits = jl.open(tmp_path / "bits.npy")
    assert bits.sensor == scene.sensor
    assert (bits.to_array() == scene.bits.to_array()).all()
    assert (np.load(tmp_path / "truth.npy") == scene.image()).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--photons", 0.3], "photons: is for a moving scene; add --motion shake"),
        (["--truth", "truth.npy"], "truth: is for a moving scene"),
        (
            ["--motion", "walk"],
            "motion: there is no file walk; expected a file with a line for each frame, or",
        ),
        (["--motion", "text.csv"], "text.csv: expected numbers that commas or spaces separate"),
        (["--motion", "three.csv"], "three.csv: expected 2 or 4 numbers in each line"),
        (["--motion", "shake", "--truth", "truth.xyz"], "truth.xyz: expected a name that ends"),
        (["--motion", "three.csv", "--truth", "three.csv"], "three.csv: expected a name"),
        (["--motion", "shake", "--truth", "./bits.npy"], "a different name for each output"),
        (["--motion", "shake", "--truth", "bits.mask.npy"], "a different name for each output"),
        (["--motion", "shake", "--foreground", "photo.png"], "objects, such as layers, got shake"),
    ],
)
def test_bad_options_of_motion_are_refused(run, photo, tmp_path, options, message):
    (tmp_path / "text.csv").write_text("0, 0\none, two\n")
    (tmp_path / "three.csv").write_text("0, 0, 1\n")
    np.save("dead.npy", np.zeros((40, 49), bool))
    before = file_names(tmp_path)
    arguments = ["simulate", photo, "-o", "bits.npy", "-k", 1, "--mask", "dead.npy"]
    status, output = run(*arguments, *options)
    assert status == 1
    assert message in output
    assert file_names(tmp_path) == before


@pytest.mark.parametrize("shape", [(5, 40, 50), (1, 40, 50), (2, 5, 40, 3)])
def test_a_stack_of_images_is_no_photograph(run, tmp_path, shape):
    """It would become one short image of many channels."""
    np.save(tmp_path / "stack.npy", np.full(shape, 0.5, np.float32))
    before = file_names(tmp_path)
    status, output = run("simulate", "stack.npy", "-o", "bits.npy")
    assert status == 1
    assert "photo: expected one image, (H, W) or (H, W, C) with at most 4 channels, got" in output
    assert file_names(tmp_path) == before


def test_a_simulated_capture_and_its_images_state_their_origin(run, color, tmp_path):
    options = ["-t", 3, "--gray", "--white", 400, "--motion", "shake", "--seed", 5]
    status, output = run("simulate", color, "-o", "bits.npy", *options)
    assert status == 0, output
    assert run("reconstruct", "bits.npy", "-o", "image.tif", "--method", "mle")[0] == 0
    stated = json.loads((tmp_path / "bits.json").read_text())["provenance"]
    photo = Path(color).name
    assert (stated["format"], stated["name"]) == ("simulation", photo)
    expected = [
        f"simulated from {photo} by jotlight {jl.__version__} with seed 5, gray, white 400.0, "
        "motion shake",
        f"SHA-256 of {photo}: {file_checksum(tmp_path / color)}",
    ]
    assert stated["notes"] == expected
    assert read_note(tmp_path / "image.tif")["provenance"]["origin"]["notes"] == expected
    assert run("convert", "bits.npy", "-o", "copy.npy.gz")[0] == 0
    for name in ("bits.npy", "image.tif", "copy.npy.gz"):
        shown = " ".join(run("info", name)[1].split())
        assert all(shown.count(note) == 1 for note in expected)
        assert "assumed" not in shown
        assert f"converted from {photo}" not in shown


def test_commands_print_the_origin_of_a_simulated_capture_in_one_line(run, photo):
    assert run("simulate", photo, "-o", "bits.npy", "-t", 4)[0] == 0
    lines = run("reconstruct", "bits.npy", "-o", "image.png", "-m", "mle")[1].splitlines()
    origin = f"simulated from {Path(photo).name} by jotlight {jl.__version__} with seed 0"
    assert [line for line in lines if Path(photo).name in line] == [origin]


def test_simulated_readings_of_several_bits_state_their_origin(run, photo, tmp_path):
    assert run("simulate", photo, "-o", "bits.npy", "--bit-depth", 4)[0] == 0
    notes = json.loads((tmp_path / "bits.json").read_text())["provenance"]["notes"]
    assert notes[0].endswith(" with seed 0")
