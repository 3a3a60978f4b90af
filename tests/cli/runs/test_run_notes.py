"""What runs over captures and windows print about assumptions and motion."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.runs.run_notes import summarize_notes
from moving import in_memory

WIDTH = "npy: the width is taken to be a multiple of 8"
ASSUMED = "the bits do not state their sensor; assumed: Sensor(frames=64"
MOVES = "moves, so the image is blurred"


def save_moving(name, motion):
    sensor = jl.Sensor(frames=256)
    scene = jl.datasets.moving(motion=motion, sensor=sensor, shape=(64, 64), rng=0)
    jl.save(in_memory(scene), name)


def save_plain(path):
    np.save(path, np.asarray(jl.open(path).packed))
    path.with_suffix(".json").unlink()


def test_windows_print_what_was_assumed(run, captures):
    save_plain(captures[0])
    args = ("reconstruct", captures[0], "-o", "v.zarr", "--window", 64, "-m", "mle")
    code, out = run(*args, "--bits")
    assert code == 0, out
    lines = out.splitlines()
    assert WIDTH in lines
    assert any(line.startswith(ASSUMED) for line in lines)


@pytest.mark.parametrize("command", [("reconstruct", "-m", "mle"), ("convert",)])
def test_each_note_of_several_captures_is_printed_once(run, captures, command):
    for path in captures[:2]:
        save_plain(path)
    verb, *options = command
    code, out = run(verb, *captures, "-o", "o/{name}.npy", *options, "--bits")
    assert code == 0, out
    assert out.count(WIDTH) == 1
    assert f"{WIDTH} (2 of 3 captures)" in out
    assert ("sensor: Sensor(frames=64) (1 of 3 captures)" in out) == (verb == "reconstruct")


def test_many_different_notes_are_counted():
    lines = summarize_notes([[f"sensor: {number}"] for number in range(30)])
    assert len(lines) == 21
    assert lines[-1] == "and 10 other notes"
    assert summarize_notes([]) == []


def test_captures_that_fail_print_no_notes(run, captures):
    captures[0].write_bytes(b"damaged")
    code, out = run("reconstruct", captures[0], "-o", "v.zarr", "--window", 16, "-m", "mle")
    assert code == 1
    assert len(out.splitlines()) == 1


@pytest.mark.slow
def test_windows_and_captures_of_a_moving_scene_are_blurred(run, tmp_path):
    save_moving(tmp_path / "moving.npy", "fast")
    save_moving(tmp_path / "still.npy", "static")
    base = ("reconstruct", "-m", "mle", "-o")
    video = ("m.zarr", "moving.npy", "--window", 128)
    code, out = run(*base, *video)
    assert code == 0, out
    assert f"motion: the scene {MOVES}; `jotlight film --motion` aligns" in " ".join(out.split())
    assert MOVES not in run(*base, *video)[1]  # the result was complete before
    code, out = run(*base, "{name}.tif", "moving.npy", "still.npy")
    assert f"motion: the scene of moving {MOVES}; `jotlight reconstruct --motion` of" in out
    assert MOVES not in run(*base, "s.zarr", "still.npy", "--window", 128)[1]
    assert MOVES not in run("convert", "moving.npy", "-o", "c.zarr", "--window", 128)[1]
