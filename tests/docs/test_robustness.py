"""docs/results/robustness.md follows from the lines of JSON beside it, which are of full runs."""

import re
from pathlib import Path

import pytest

from damage.commands import COMMANDS
from damage.page import PAGE_FILE, build_page
from damage.record import read_rows
from examples import READERS

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs/results"
PARTS = {"readers", "engine", "kills", "disks", "flips", "sweep"}


@pytest.fixture(scope="module")
def rows():
    return read_rows(RESULTS / "robustness")


def entry_points():
    """Return the names of the engine's entry points that can be fuzzed."""
    sources = (path.read_text("utf-8") for path in (ROOT / "fuzz/engine/targets").glob("*.rs"))
    return {name for text in sources for name in re.findall(r'\(\s*"(\w+)",\s*check_', text)}


def test_the_page_follows_from_the_json(rows):
    assert build_page(rows) == (RESULTS / PAGE_FILE).read_text("utf-8")


def test_every_part_ran_in_full(rows):
    runs = {row["of"]: row["command"] for row in rows if row["part"] == "run"}
    assert runs.keys() == PARTS
    assert [
        command for command in runs.values() if "--quick" in command or "--only" in command
    ] == []


def test_the_fuzzers_tried_at_least_a_hundred_thousand_inputs_each(rows):
    fuzzed = [row for row in rows if row["part"] in ("readers", "engine")]
    names = {part: {row["name"] for row in fuzzed if row["part"] == part} for part in PARTS}
    assert names["readers"] >= READERS.keys()
    assert names["engine"] == entry_points()
    inputs = {(row["part"], row["name"]): row["inputs"] for row in fuzzed}
    assert min(inputs.values()) >= 10**5
    assert sum(inputs.values()) >= 10**7


def test_100_processes_were_killed_and_every_writer_met_full_disks(rows):
    assert sum(row["kills"] for row in rows if row["part"] == "kills") >= 100
    disks = {row["name"]: row["free"] for row in rows if row["part"] == "disks"}
    assert disks.keys() == {each.name for each in COMMANDS}
    assert all(disks.values())


def test_nothing_was_damaged(rows):
    assert [row["name"] for row in rows if row.get("violations") or row.get("findings")] == []
    flips = [row for row in rows if row["part"] == "flips"]
    assert all(row["outcomes"] == {"refused": 400} for row in flips)
