"""`reconstruct --motion`: bits, counts, and colors along the motion of the scene, and its files."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest
import tifffile

import jotlight as jl
from folders import file_names
from jotlight.formats.capture import CountStack
from jotlight.formats.files.checksums import file_checksum
from jotlight.images.io import read_image, read_note
from jotlight.sensing.parameters.provenance import Provenance


@pytest.mark.slow
def test_the_image_is_that_of_the_merged_bits(run, moving, tmp_path):
    arguments = ["reconstruct", "moving.npy", "--motion", "-o", "a.npy"]
    more = ["--save-motion", "m.safetensors", "--maps", "maps.npz", "--at", 10]
    status, output = run(*arguments, *more)
    assert status == 0, output
    motion = jl.align(moving, at=10)
    merged = jl.merge(moving, motion=motion)
    expected = jl.pretrained(moving.sensor).reconstruct(merged)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), expected)
    np.testing.assert_array_equal(jl.reconstruct(jl.merge(moving, at=10)), expected)
    np.testing.assert_array_equal(jl.Motion.load("m.safetensors").nodes, motion.nodes)
    with np.load("maps.npz") as maps:
        assert set(maps) == {"trials", "acceptance", "posterior_error", "flags"}
        for name in maps:
            np.testing.assert_array_equal(maps[name], getattr(merged, name))
    paths = np.stack([motion.at(time) for time in motion.times])
    half, tenth = np.quantile(np.sqrt((paths**2).sum(axis=1)).max(axis=0), (0.5, 0.9))
    assert f"motion: {motion.model}; half of the scene moves by {half:.3g} jots" in output
    assert f"and a tenth by {tenth:.3g} or more" in output
    assert f"{merged.flags.mean():.1%} of the pixels may have larger errors" in output
    low, middle = merged.trials.min(), np.median(merged.trials)
    assert f"{low:g} trials per pixel or more, {middle:g} in the median" in output
    assert f"{merged.acceptance.mean():.1%} of the bits along the motion agree" in output
    assert f"to {np.median(merged.posterior_error):.2g} jots in the median" in output
    assert "the scene moves, so" not in output


@pytest.mark.slow
def test_a_motion_is_used_again(run, moving, tmp_path):
    arguments = ["reconstruct", "moving.npy", "--motion", "-m", "mle"]
    assert run(*arguments, "-o", "a.npy", "--save-motion", "m.safetensors")[0] == 0
    again = ["--motion-file", "m.safetensors"]
    assert run(*arguments, "-o", "b.npy", *again)[0] == 0
    np.testing.assert_array_equal(np.load("a.npy"), np.load("b.npy"))
    assert run(*arguments, "-o", "c.npy", *again, "--at", 5)[0] == 0
    motion = jl.Motion.load("m.safetensors")
    expected = jl.mle(jl.merge(moving, at=5, motion=motion))
    np.testing.assert_array_equal(np.load("c.npy"), expected)
    status, output = run(*arguments, "-o", "d.npy", *again, "--frame-range", "0:30")
    assert status == 1
    last = len(moving) - 1
    assert f"expected that of frames 0 to 29, got that of frames 0 to {last};" in output
    assert "leave out --motion-file to align these frames" in output
    status, output = run(*arguments, "-o", "e.npy", *again, "--maps", "m.safetensors")
    assert status == 1
    assert "ends in .npz, .npy, .tif" in output
    (tmp_path / "m.npy").write_bytes((tmp_path / "m.safetensors").read_bytes())
    status, output = run(*arguments, "-o", "m.npy", "--motion-file", "m.npy")
    assert status == 1
    assert "choose another name" in output


def recorded(path):
    """Return the record beside an array, or the note in an image."""
    beside = path.with_name(f"{path.name}.json")
    return json.loads(beside.read_text())["origin"] if beside.exists() else read_note(path)


@pytest.mark.slow
def test_the_record_states_how_frames_were_aligned(run, moving, tmp_path):
    arguments = ["reconstruct", "moving.npy", "--motion", "--motion-model", "affine"]
    options = ["-m", "admm-tv", "--weight", 0.1, "--at", 10, "--save-motion", "m.safetensors"]
    assert run(*arguments, *options, "-o", "a.npy")[0] == 0
    record = recorded(tmp_path / "a.npy")
    assert (record["method"], record["options"]) == ("admm-tv", {"weight": 0.1})
    aligned = {"model": "affine", "found": "affine", "upsample": 1, "at": 10}
    assert record["motion"] == aligned
    _, output = run("info", "a.npy")
    assert "model=affine" in output
    assert "weight=0.1" in output
    again = ["reconstruct", "moving.npy", "--motion", "--motion-file", "m.safetensors"]
    assert run(*again, "--upsample", 2, "-o", "b.png")[0] == 0
    note, checksum = recorded(tmp_path / "b.png"), file_checksum(tmp_path / "m.safetensors")
    file = {"file": "m.safetensors", "sha256": checksum}
    assert note["motion"] == aligned | {"model": None, "upsample": 2} | file
    assert (note["curve"], note["white"]) == ("linear", 1.0)
    assert run("reconstruct", "moving.npy", "-m", "mle", "-o", "c.npy")[0] == 0
    assert recorded(tmp_path / "c.npy")["motion"] is None


def test_the_record_of_a_film_states_how_frames_were_aligned(run, moving, tmp_path):
    arguments = ["film", "moving.npy", "--motion", "--motion-model", "none", "-m", "mle"]
    options = ["--window", 24, "--step", 12, "--causal", "--curve", "log", "--white", 0.7]
    assert run(*arguments, *options, "-o", "film.gif")[0] == 0
    record = recorded(tmp_path / "film.gif")
    aligned = {"model": "none", "upsample": 1, "causal": True, "recurrent": False, "memory": True}
    assert record["motion"] == aligned
    assert (record["curve"], record["white"]) == ("log", 0.7)
    assert run("film", "moving.npy", "-m", "mle", "--window", 24, "-o", "still.npy")[0] == 0
    assert recorded(tmp_path / "still.npy")["motion"] is None


@pytest.mark.slow
def test_a_finer_grid(run, moving, tmp_path):
    arguments = ["reconstruct", "moving.npy", "--motion", "--upsample", 2, "-o", "a.npy"]
    status, output = run(*arguments, "--motion-model", "affine", "--maps", "maps.npz")
    assert status == 0, output
    merged = jl.merge(moving, motion=jl.align(moving, model="affine"), upsample=2)
    expected = jl.reconstruct(merged)
    assert expected.shape == (96, 128)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), expected)
    with np.load("maps.npz") as maps:
        np.testing.assert_array_equal(maps["trials"], merged.trials)
    assert f"{np.mean(merged.trials > 0):.1%} of the finer grid has readings" in output
    error = np.median(merged.posterior_error) / 2  # in jots, as all other lengths
    assert f"to {error:.2g} jots in the median" in output


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*brighter than the largest intensity")
def test_counts_are_aligned(run, moving, tmp_path):
    counts = moving.to_array().reshape(24, 2, 48, 64).sum(axis=1).astype(np.uint16)
    stack = CountStack(counts, Provenance("npy", "counts"), trials=2)
    np.save("counts.npy", counts)
    arguments = ["reconstruct", "counts.npy", "--frames", 48, "--motion"]
    status, output = run(*arguments, "-m", "mle", "-o", "a.npy", "--max-intensity", 1)
    assert status == 0, output
    motion = jl.align(stack)
    np.testing.assert_array_equal(np.load("a.npy"), jl.mle(jl.merge(stack, motion=motion)))
    assert f"motion: {motion.model}; half of the scene moves by " in output


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the motion does not explain the scene")
def test_colors_share_one_motion(run, moving, tmp_path):
    frames = moving.to_array()
    colors = jl.Bits.from_array(np.stack([frames, frames, frames[:, ::-1]], axis=3))
    jl.save(colors, "color.npy")
    arguments = ["reconstruct", "color.npy", "--motion", "--motion-model", "affine", "-m", "mle"]
    status, output = run(*arguments, "-o", "a.tif", "--maps", "maps.tif")
    assert status == 0, output
    image = read_image(tmp_path / "a.tif")
    assert image.shape == (48, 64, 3)
    np.testing.assert_array_equal(image[..., 0], image[..., 1])
    assert tifffile.imread(tmp_path / "maps.tif").shape[1:] == (48, 64, 3)


def test_uncertainty_is_that_of_the_merged_bits(run, moving, tmp_path):
    arguments = ["reconstruct", "moving.npy", "--motion", "--motion-model", "none", "-o", "a.npy"]
    status, output = run(*arguments, "--uncertainty", "u.npz")
    assert status == 0, output
    assert "motion: none, the scene stands still" in output
    merged = jl.merge(moving, motion=jl.align(moving, model="none"))
    with np.load("u.npz") as found:
        np.testing.assert_array_equal(
            found["standard_error"], jl.uncertainty(merged).standard_error
        )


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--at", 0], "at: is for the motion of the scene; add --motion"),
        (["--at", 3], "at: is for the motion of the scene; add --motion"),
        (["--motion-model", "affine"], "motion-model: is for the motion of the scene; add"),
        (["--maps", "m.npz"], "maps: is for the motion of the scene; add --motion"),
        (["--motion", "--motion-model", "rigid"], "motion-model: expected one of auto, none"),
        (["--motion", "--at", 48], "at: expected a time from 0 to 47 in frames, got 48"),
        (["--motion", "--maps", "m.png"], "ends in .npz, .npy, .tif"),
        (["--motion", "--save-motion", "m.npz"], "save-motion: expected a name that ends in .saf"),
        (["--motion", "--save-motion", "a.png"], "save-motion: expected a name that ends in .saf"),
        (["--motion", "--maps", "b.npy"], "a different name for each output"),
        (["--motion", "--motion-file", "no.safetensors"], "there is no file no.safetensors"),
        (
            ["--motion", "--motion-file", "m.safetensors", "--motion-model", "auto"],
            "motion-model: is for a new motion; leave out --motion-file",
        ),
        (["--motion", "--motion-file", "moving.npy"], "moving.npy"),
        (["--upsample", 2], "upsample: is for the motion of the scene; add --motion"),
        (["--motion", "--upsample", 3], "upsample: expected 1 or 2, got 3"),
        (["--motion", "--upsample", 2, "-m", "mle"], "upsample: expected a network, but the"),
        (
            ["--motion", "--upsample", 2, "--uncertainty", "u.npz"],
            "uncertainty: is not known for the finer grid",
        ),
    ],
)
def test_bad_input_gets_one_clear_line_and_leaves_no_files(
    run, moving, tmp_path, arguments, expected
):
    before = file_names(tmp_path)
    output_file = "b.npy" if "b.npy" in arguments else "a.png"
    status, output = run("reconstruct", "moving.npy", "-o", output_file, *arguments)
    assert status == 1
    [line] = output.splitlines()
    assert line.startswith("error: ")
    assert expected in line
    assert file_names(tmp_path) == before


def test_a_finer_grid_is_refused_for_a_mosaic_with_the_option_to_leave_out(run, tmp_path):
    sensor = jl.Sensor(frames=16, mosaic="RGGB")
    jl.save(sensor.expose(np.full((16, 16, 3), 0.5), rng=0, channel_axis=-1), tmp_path / "m.npy")
    status, output = run("reconstruct", "m.npy", "-o", "a.png", "--motion", "--upsample", 2)
    assert status == 1
    assert "with a mosaic, got 2; leave out --upsample" in " ".join(output.split())


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends signals")
def test_ctrl_c_stops_the_alignment_and_leaves_no_files(tmp_path):
    scene = jl.datasets.moving(
        motion="shake", sensor=jl.Sensor(frames=100), shape=(256, 300), photons=0.5, rng=0
    )
    packed = np.tile(np.asarray(scene.bits.packed), (40, 1, 1))
    jl.save(jl.Bits(packed, 300), tmp_path / "moving.npy")
    before = file_names(tmp_path)
    code = (
        "import sys, signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
        "sys.argv = 'jotlight reconstruct moving.npy --motion -o a.png'.split();"
        "from jotlight.cli.app import main; main()"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    end = time.monotonic() + 30
    while file_names(tmp_path) == before and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(0.3)
    assert child.poll() is None
    child.send_signal(2)
    _, output = child.communicate(timeout=30)
    assert child.returncode == 130
    assert output.splitlines()[-1] == "error: stopped"
    assert file_names(tmp_path) == before
