"""Speed benchmarks as the tests use them: tasks, runs, and cases that take no time."""

import numpy as np

from suite.case import Case
from suite.probes import MULTIPLY_ADDS, READING, SAME_DURATION
from suite.timing import Effort

BRIEF = Effort(rounds=2, slow_rounds=1, min_seconds=0.0, words=1 << 10, pause=0.0)
PROBES = [MULTIPLY_ADDS, READING, SAME_DURATION]


def make_task(name="counting", title="Counting", **seconds):
    """Return the times of 10 items on a machine with 1000 multiply-adds and bytes per second."""
    times = {program: [value, value] for program, value in seconds.items()}
    probes = {probe: [1.0, 1.0] for probe in PROBES}
    return {
        "name": name,
        "title": title,
        "description": "A description.",
        "items": 10.0,
        "unit": "frames",
        "operations": 100.0,
        "direct_operations": None,
        "bytes": 500.0,
        "operations_note": "all",
        "same_for_threads": [1, 7],
        "agreement": "difference",
        "tolerance": 0,
        "level_differences": {},
        "differences": {},
        "left_out": {},
        "probes": {"operations": {"1": 2000.0}, "bytes": 1000},
        "seconds": {"1": {**times, **probes}},
    }


def make_run(*tasks, **parts):
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
    settings = {"quick": True, "threads": [1], "rounds": 2, "seconds_per_turn": 0.02}
    return {**settings, "machine": machine, "tasks": list(tasks), **parts}


def make_case(rivals, run=lambda threads: np.ones(3), **fields):
    return Case(
        name="any",
        title="Any",
        description="A description.",
        items=3,
        unit="numbers",
        run=run,
        rivals=rivals,
        difference=lambda result, other: float(np.abs(result - other).max()),
        agreement="largest difference",
        tolerance=1e-3,
        operations=3,
        bytes=3,
        operations_note="all",
        **fields,
    )
