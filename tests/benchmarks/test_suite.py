"""The benchmarks: verdicts, figures from times, and a short run of the command."""

import copy
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from suite import claims as claims_of
from suite.case import CannotRunError, Case, Rival, measure
from suite.claims import Claim
from suite.figures import bound_by, of_bound, paired, peak, ratio, speed_up, spread_of
from suite.page import page
from suite.tables import short
from suite.timing import Effort, race

ROOT = Path(__file__).parents[2]
BRIEF = Effort(rounds=2, few=1, least=0.0, words=1 << 10, pause=0.0)


PROBES = ["multiply-adds", "reading", "multiply-adds as long as ours"]


def path(**seconds):
    """Times of 10 items; the machine does 1000 multiply-adds and reads 1000 bytes a second."""
    times = {name: [value, value] for name, value in seconds.items()}
    probes = {name: [1.0, 1.0] for name in PROBES}
    return {
        "name": "counting",
        "title": "Counting",
        "words": "Words.",
        "items": 10.0,
        "unit": "frames",
        "slots": 100.0,
        "bytes": 500.0,
        "counted": "all",
        "same_for_threads": [1, 7],
        "agreement": "difference",
        "tolerance": 0,
        "levels": {},
        "differences": {},
        "left_out": {},
        "probes": {"operations": {"1": 2000.0}, "bytes": 1000},
        "seconds": {"1": {**times, **probes}},
    }


def found(*paths, **parts):
    machine = {
        "date": "2026-01-01",
        "commit": "",
        "jotlight": "1",
        "python": "3",
        "processor": "a processor",
        "instructions": [],
        "level": "scalar",
        "system": "any",
        "cores": 1,
        "memory_gib": 1.0,
        "load": None,
        "packages": {"numpy": "2", "torch": None},
    }
    settings = {"quick": True, "threads": [1], "rounds": 2, "seconds_a_turn": 0.02}
    return {**settings, "machine": machine, "paths": list(paths), **parts}


@pytest.mark.parametrize(
    ("wanted", "measured", "at_most", "verdict"),
    [
        (10, 10.0, False, "met"),
        (10, 9.999, False, "not met"),
        (0.4, 0.4, True, "met"),
        (0.4, 0.401, True, "not met"),
        (10, None, False, "not measured"),
    ],
)
def test_the_verdict_lies_on_the_right_side(wanted, measured, at_most, verdict):
    assert Claim("", wanted, measured, at_most=at_most).verdict == verdict


@pytest.mark.parametrize(("reading", "verdict"), [(0.51, "met"), (0.49, "not met")])
def test_counting_is_held_against_reading_the_same_bytes(reading, verdict):
    seconds = {"jotlight": 1.0, claims_of.SAME_BYTES: reading}
    (claim,) = claims_of.claims(found(path(**seconds)))
    assert claim.measured == pytest.approx(reading)
    assert claim.verdict == verdict
    assert claim.bound == "50% of what memory alone would allow"


@pytest.mark.parametrize(("slow", "verdict"), [(1.9, "met"), (1.7, "not met")])
def test_two_threads_are_held_against_one(slow, verdict):
    one = path(jotlight=slow)
    one["seconds"]["2"] = path(jotlight=1.0)["seconds"]["1"]
    one["probes"]["operations"]["2"] = 3600.0
    claim = claims_of.with_threads(one, 2)
    assert claim.bound == (
        "multiply-adds alone: 1.80, reading: 1.00; multiply-adds as long as this: 1.00"
    )
    one["probes"]["operations"]["2"] = 3400.0
    assert claims_of.with_threads(one, 2).verdict == "not measured"
    assert claim.measured == pytest.approx(slow)
    assert claim.verdict == verdict


def test_the_filter_alone_leaves_out_what_one_tap_takes():
    one = path(jotlight=0.3, **{claims_of.WITHOUT: 0.1})
    assert claims_of.filter_share(one) == pytest.approx((100 - 10) / 1000 / 0.2)


@pytest.mark.parametrize(("difference", "verdict"), [(9e-5, "met"), (2e-4, "not met")])
def test_instruction_sets_are_held_against_scalar_code(difference, verdict):
    one = path(jotlight=1.0) | {"levels": {"x86-64-v3": difference / 2, "x86-64-v4": difference}}
    (claim,) = claims_of.levels([one])
    assert claim.verdict == verdict


def test_the_largest_difference_is_held_against_its_own_tolerance():
    one, other = path(jotlight=1.0), path(jotlight=1.0)
    one["tolerance"], one["differences"] = 0.5, {"a": 0.1, "b": 0.2}
    other["differences"] = {"c": 0.0}
    (claim,) = claims_of.agreement([one, other])
    assert claim.measured == pytest.approx(0.4)
    assert claim.verdict == "met"


def test_a_rival_that_was_not_there_is_not_measured():
    (claim,) = claims_of.claims(found(path(jotlight=1.0)))
    assert claim.verdict == "not measured"


def test_figures_follow_from_the_times():
    one = path(jotlight=1.0, rival=3.0)
    assert ratio(one, "rival", 1) == 3
    assert peak(one, 1) == 1000
    assert bound_by(one, 1) == "memory"
    assert of_bound(one, 1) == 0.5
    assert spread_of([1, 2, 3, 4, 5]) == pytest.approx(2 / 3)
    assert spread_of([1.0]) == 0
    # The machine became twice as slow halfway; the ratio of each round does not mind.
    assert paired([4, 4, 8, 8], [2, 2, 4, 4]) == 2
    faster = copy.deepcopy(one)
    faster["seconds"]["2"] = {"jotlight": [0.5, 0.5]}
    assert speed_up(faster, 2) == 2


@pytest.mark.parametrize(
    ("value", "words"), [(1234.5, "1,234"), (99.96, "100"), (0.01234, "0.0123"), (2, "2")]
)
def test_numbers_are_short(value, words):
    assert short(value) == words


def test_contenders_take_turns():
    calls = []
    runs = {name: lambda threads, name=name: calls.append((name, threads)) for name in "ab"}
    times = race(runs, [1], BRIEF)
    assert [len(times["1"][name]) for name in "ab"] == [2, 2]
    # Two calls a turn, the first of which is not counted.
    assert calls == [(name, 1) for name in "aabb"] * 2


def case(rivals, ours=lambda threads: np.ones(3)):
    return Case(
        name="any",
        title="Any",
        words="",
        items=3,
        unit="numbers",
        ours=ours,
        rivals=rivals,
        difference=lambda ours, theirs: float(np.abs(ours - theirs).max()),
        agreement="largest difference",
        tolerance=1e-3,
        slots=3,
        bytes=3,
        counted="all",
    )


def test_what_cannot_run_is_left_out_and_said():
    def refuses(_):
        raise CannotRunError("it would not")

    rivals = [
        Rival("same", lambda _: lambda: np.ones(3)),
        Rival("absent", lambda _: None, "a_package_that_is_not_there"),
        Rival("refuses", refuses),
    ]
    measured = measure(case(rivals), [1], BRIEF)
    assert measured["left_out"] == {
        "absent": "the package a_package_that_is_not_there is not installed",
        "refuses": "it would not",
    }
    assert list(measured["seconds"]["1"]) == ["jotlight", "same", *PROBES]
    assert measured["differences"] == {"same": 0}
    assert "Any: refuses is left out, it would not." in page(found(measured))


def test_nothing_is_timed_where_results_differ():
    with pytest.raises(AssertionError, match="wrong differs"):
        measure(case([Rival("wrong", lambda _: lambda: np.zeros(3))]), [1], BRIEF)
    with pytest.raises(AssertionError, match="7 threads differ"):
        measure(case([], ours=lambda threads: np.full(3, threads)), [1], BRIEF)


def test_the_command_writes_json_and_a_page(tmp_path):
    command = [
        sys.executable,
        str(ROOT / "benchmarks/speed/run.py"),
        "--quick",
        "--only",
        "counting",
    ]
    subprocess.run([*command, "--output", str(tmp_path)], check=True, capture_output=True)
    record = json.loads((tmp_path / "speed/run.json").read_text("utf-8"))
    assert page(record) == (tmp_path / "speed.md").read_text("utf-8")
    (counting,) = record["paths"]
    assert counting["differences"]["NumPy, unpack and sum"] == 0


def test_a_debug_build_is_refused():
    code = (
        "import sys; sys.path.insert(0, 'benchmarks/speed'); sys.argv = ['run.py', '--quick']\n"
        "from jotlight import _engine; _engine.DEBUG_BUILD = True\n"
        "import run; run.main()"
    )
    refused = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert refused.returncode == 1
    assert "debug build" in refused.stderr
