"""The script that kills processes, fills disks, and flips bits finds what it looks for."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from damage import disks, flips, kills
from damage.commands import COMMANDS, Command
from damage.page import build_page
from damage.workplace import Expected, Workplace
from jotlight.formats.registry import WRITERS

SCRIPT = Path(__file__).parents[2] / "tools/robustness/run.py"

SLOW_WRITER = """
import sys, time
with open(sys.argv[1], "w") as file:
    for part in "{inputs}":
        file.write(part)
        file.flush()
        time.sleep(0.2)
"""
"""A program that writes one letter after the other to its output."""


def small_workplace(folder):
    """Return a workplace without inputs."""
    for name in ("in", "old", "out"):
        (folder / "work" / name).mkdir(parents=True)
    return Workplace(folder / "work", {"in": "folder", "old": "folder"})


@pytest.mark.slow
def test_kills_find_incomplete_outputs(tmp_path):
    place = small_workplace(tmp_path)
    command = Command("slow", ("out/a.txt",), script=SLOW_WRITER)
    expected = Expected.of(command, place, tmp_path / "before")
    row = kills.kill_at_random(command, place, expected, 8)
    assert row["kills"] == 8
    assert any("damaged: a.txt" in text for text in row["violations"])


@pytest.mark.slow
def test_kills_find_remaining_files_and_changed_inputs(tmp_path):
    place = small_workplace(tmp_path)
    script = (
        'import pathlib, time\npathlib.Path("out/.b").touch()\n'
        'pathlib.Path("in/c").touch()\ntime.sleep(0.3)\n'
    )
    command = Command("careless", (), script=script, replaces=False)
    expected = Expected.of(command, place, tmp_path / "before")
    (place.folder / "in/c").unlink()
    row = kills.kill_at_random(command, place, expected, 5)
    assert any("remains: .b" in text for text in row["violations"])
    assert any("an input changed" in text for text in row["violations"])


@pytest.mark.parametrize(
    ("status", "text", "violations"),
    [
        (1, "error: cannot write out/a.npy: No space left on device\n", []),
        (-7, "error: cannot write out/a.npy: No space left on device\n", ["status -7"]),
        (1, "", ["0 lines"]),
        (1, "Traceback\nOSError: cannot write out/a.npy: No space left on device\n", ["2 lines"]),
        (1, "error: 262144 requested and 992 written\n", ["does not contain", "names no output"]),
    ],
)
def test_messages_about_full_disks_are_checked(status, text, violations):
    expected = Expected(Path(), {}, {"a.npy": ""})
    found = disks.check_message(COMMANDS[0], status, text, expected)
    assert len(found) == len(violations)
    for violation, words in zip(found, violations, strict=True):
        assert words in violation


def test_flips_find_undetected_damage(monkeypatch):
    others = {name: why for name, why in flips.NO_CHECKSUM.items() if name != "visionsim"}
    monkeypatch.setattr(flips, "NO_CHECKSUM", others)
    (row,) = flips.measure(quick=True, only="visionsim: bits")
    assert row["flips"] == flips.QUICK_FLIPS
    assert row["outcomes"]["other content"] > 5
    assert len(row["violations"]) > 5


def test_every_writer_meets_a_full_disk():
    words = [set(each.arguments) for each in COMMANDS if each.arguments[0] == "convert"]
    for name, writer in WRITERS.items():
        used = [each for each in words if name in each]
        assert any("out/a" in each for each in used) == (writer.folder or not writer.extensions)
        assert any("in/counts.tif" in each for each in used) == (writer.counts is not None)


def test_every_format_has_a_checksum_or_a_reason_why_not():
    assert {*flips.NO_CHECKSUM} & {*WRITERS} == {
        "visionsim",
        *("swissspad2", "swissspad2-full", "spad512s", "spad512s-sparse"),
    }


def test_there_are_100_kills():
    assert sum(kills.SHARES.values()) == 100


def test_the_page_shows_every_row_and_violation():
    run = {"part": "run", "date": "2026-01-01", "commit": "a", "python": "3.11"}
    run |= {"seconds": 3, "libraries": {"numpy": "2.0", "torch": None}, "command": "python x"}
    reader = {"part": "readers", "commit": "b", "seconds": 2.0, "findings": 0, "branches": 7,
              "library_crashes": 1}  # fmt: skip
    rows = [
        *({**run, "of": part} for part in ("readers", "engine", "kills", "disks", "flips")),
        {**reader, "name": "npy", "inputs": 5},
        {**reader, "name": "npy", "inputs": 1000},
        {"part": "engine", "commit": "b", "name": "counts", "inputs": 2000, "seconds": 1.0,
         "findings": 1, "branches": 9},
        {"part": "kills", "name": "train", "kills": 12, "old": 9, "violations": ["a | b"]},
        {"part": "kills at changes", "name": "train", "kills": 4, "old": 3, "between": 1,
         "violations": []},
        {"part": "disks", "name": "video", "free": [0, 4096], "fits": 1, "violations": []},
        {"part": "flips", "name": "npz: counts", "flips": 400, "files": 1, "bytes": 900,
         "outcomes": {"refused": 400}, "reads": {"refused": 390, "same content": 10},
         "violations": []},
        {"part": "found", "by": "fuzzing", "problem": "a crash", "now": "an error"},
    ]  # fmt: skip
    page = build_page(rows)
    for line in (
        "| readers | 1,000 | 0 | 2026-01-01 | 3 | commit a, Python 3.11, numpy 2.0 | `python x` |",
        "| Python: npy | b | 1,000 | 2 | 500 | 7 | 0 | 1 |",
        "| engine | 2,000 | 1 | 2026-01-01 | 3 | commit a, Python 3.11, numpy 2.0 | `python x` |",
        "| Rust: counts | b | 2,000 | 1 | 2,000 | 9 | 1 | – |",
        "| **all** |  | 3,000 | 3 |  |  | 1 |  |",
        "| train | 12 | 9 | 3 | 4 | 1 | 1 |",
        "- train: a | b",
        "| video | 2 | 0, 4 | 1 | 0 |",
        "| npz: counts | 1 | 900 | 400 | 400 | 390 | 10 | 0 |",
        "| fuzzing | a crash | an error |",
    ):
        assert line in page.splitlines(), line


@pytest.mark.exhaustive
@pytest.mark.parametrize("part", ["kills", "disks", "flips"])
def test_a_quick_run_finds_nothing(part, tmp_path):
    command = [sys.executable, str(SCRIPT), part, "--quick", "--output", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    if "does not let" in done.stderr:
        pytest.skip("this system does not let the script make small disks")
    assert done.returncode == 0, done.stderr
    lines = (tmp_path / "robustness" / f"{part}.jsonl").read_text().splitlines()
    run, *rows = map(json.loads, lines)
    assert run["of"] == part
    assert rows
