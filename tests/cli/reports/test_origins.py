"""The origin of a result, as `jotlight info` shows it."""

import json
import os
from pathlib import Path

import pytest

from jotlight.cli.reports.origins import film_facts

READ = ("--frame-range", "16:48", "--rotate", "90")


def origin_lines(run, name):
    """Return the lines of `jotlight info`, without repeated spaces."""
    code, out = run("info", name)
    assert code == 0, out
    return [" ".join(line.split()) for line in out.splitlines()]


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("reconstruct --window 16 -m mle", "y.zarr"),
        ("reconstruct -m mle", "y.tif"),
        ("reconstruct -m mle", "y.npy"),
        ("reconstruct -m mle --chunks 1MiB", "y.png"),
        ("film --window 16 -m mle", "y.npy"),
        ("convert", "y.npy"),
    ],
)
def test_the_frames_and_the_rotation_are_shown(run, captures, command, name):
    verb, *options = command.split()
    assert run(verb, captures[0], "-o", name, *options, *READ)[0] == 0
    lines = origin_lines(run, name)
    assert "npy: frames 16:48 of 64 npy: rotated by 90 degrees counterclockwise" in " ".join(lines)
    assert sum("frames 16:48 of 64" in line for line in lines) == 1


@pytest.mark.parametrize(
    ("command", "record"),
    [
        ("reconstruct {0} -m mle", "real.npy.json"),
        ("reconstruct {0} {1} -m mle", "real.npy.json"),
        ("film {0} --window 16 -m mle", "real.npy.json"),
        ("convert {0}", "real.npy.run.json"),
    ],
)
def test_the_record_of_a_linked_output_lies_beside_the_file(run, captures, command, record):
    Path("disk").mkdir()
    Path("1-link.npy").symlink_to("disk/real.npy")
    Path("2-link.npy").symlink_to("disk/other.npy")
    verb, *words = (word.format(*captures) for word in command.split())
    several = str(captures[1]) in words
    output = "{name}-link.npy" if several else "1-link.npy"
    assert run(verb, *words, "-o", output, *READ)[0] == 0
    assert Path("disk", record).is_file()
    assert not list(Path.cwd().glob("*-link.npy*json"))
    for name in ("1-link.npy", "disk/real.npy"):
        assert "npy: frames 16:48 of 64" in " ".join(origin_lines(run, name))


def test_all_frames_as_they_are_need_no_row(run, captures):
    assert run("reconstruct", captures[0], "-o", "y.tif", "-m", "mle")[0] == 0
    assert not any(line.startswith("provenance") for line in origin_lines(run, "y.tif"))


def test_a_damaged_provenance_is_called_damaged(run, captures):
    assert run("reconstruct", captures[0], "-o", "y.npy", "-m", "mle", *READ)[0] == 0
    record = Path("y.npy.json")
    content = json.loads(record.read_text())
    content["origin"]["provenance"] = {"format": "npy"}
    record.write_text(json.dumps(content))
    lines = " ".join(origin_lines(run, "y.npy"))
    assert "provenance damaged (provenance: expected an object with format, name" in lines


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_pipes_are_no_images_of_a_film(tmp_path):
    os.mkfifo(tmp_path / "0.png")
    assert film_facts(tmp_path) == []


def test_images_of_a_film_lie_in_its_folder(tmp_path):
    (tmp_path / "film").mkdir()
    (tmp_path / "outside.png").touch()
    (tmp_path / "film/0.png").symlink_to(tmp_path / "outside.png")
    with pytest.raises(ValueError, match="outside of the folder"):
        film_facts(tmp_path / "film")
