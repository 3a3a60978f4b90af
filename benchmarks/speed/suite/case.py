"""A hot path with its rivals, and how all of them are checked and timed."""

import dataclasses
import importlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import jotlight._engine as engine
from suite import probes
from suite.threads import limited
from suite.timing import Effort, Run, race

OF_SCALAR = 1e-4
"""Differences of floats from those of scalar code that are allowed, relative to the largest."""
OTHER_THREADS = 7
"""Results are the same for this number of threads too."""


class CannotRunError(Exception):
    """Why a rival is left out."""


@dataclasses.dataclass(frozen=True)
class Rival:
    """Another way to the same result, or with `same` false to a result for the same purpose."""

    name: str
    make: Callable[[Any], Callable[[], Any]]
    """Takes the package, and gives what is timed."""
    package: str = "numpy"
    same: bool = True


@dataclasses.dataclass(frozen=True)
class Case:
    """A hot path: what is timed, what has to agree, and how much work it is."""

    name: str
    title: str
    words: str
    items: float
    unit: str
    ours: Callable[[int], Any]
    rivals: Sequence[Rival]
    difference: Callable[[Any, Any], float]
    agreement: str
    """What the difference is, in words."""
    tolerance: float
    slots: float
    """Multiply-adds, and other operations that take the place of one."""
    bytes: float
    """Read and written at least."""
    counted: str
    """How both were counted."""
    parts: dict[str, Run] = dataclasses.field(default_factory=dict)
    """Further runs of ours that are timed beside."""


def measure(case: Case, threads: Sequence[int], effort: Effort) -> dict[str, Any]:
    """Check, then time; gives what goes to the JSON.

    Raises
    ------
    AssertionError
        When a rival's result differs by more than the tolerance, or ours by number of threads or
        instruction set.
    """
    ours = np.array(case.ours(1))
    for number in {*threads, OTHER_THREADS}:
        assert np.array_equal(ours, case.ours(number)), f"{case.name}: {number} threads differ"
    levels = at_every_level(case)
    runs: dict[str, Run] = {"jotlight": case.ours, **case.parts}
    differences: dict[str, float] = {}
    left_out: dict[str, str] = {}
    for rival in case.rivals:
        try:
            run = rival.make(importlib.import_module(rival.package))
        except ImportError:
            left_out[rival.name] = f"the package {rival.package} is not installed"
            continue
        except OSError as error:
            left_out[rival.name] = f"the package {rival.package} cannot be loaded ({error})"
            continue
        except CannotRunError as error:
            left_out[rival.name] = str(error)
            continue
        found = [difference_of(case, rival, run, ours, number) for number in threads]
        if rival.same:
            differences[rival.name] = max(found)
        runs[rival.name] = lambda _, run=run: run()
    return {
        **{
            field: getattr(case, field)
            for field in ("name", "title", "words", "items", "unit", "agreement", "tolerance")
        },
        **{field: getattr(case, field) for field in ("slots", "bytes", "counted")},
        "same_for_threads": sorted({*threads, OTHER_THREADS}),
        "levels": levels,
        "differences": differences,
        "left_out": left_out,
        "probes": probes.work(threads, effort.words),
        "seconds": race({**runs, **probes.runs(effort.words, case.ours)}, threads, effort),
    }


def at_every_level(case: Case) -> dict[str, float]:
    """How far the result of each instruction set is from that of scalar code."""
    try:
        results = {}
        for level in engine.cpu_levels():
            engine.choose_cpu_level(level)
            results[level] = np.array(case.ours(1))
    finally:
        engine.choose_cpu_level(None)
    scalar = results.pop("scalar")
    allowed = 0 if scalar.dtype.kind in "biu" else OF_SCALAR
    levels = {level: largest(result, scalar) for level, result in results.items()}
    assert max(levels.values(), default=0) <= allowed, f"{case.name}: {levels}"
    return levels


def difference_of(
    case: Case, rival: Rival, run: Callable[[], Any], ours: Any, threads: int
) -> float:
    """How far the rival's result is from ours; its first call is behind it then, too."""
    with limited(threads):
        result = run()
    difference = float(case.difference(ours, result)) if rival.same else 0.0
    assert difference <= case.tolerance, f"{case.name}: {rival.name} differs: {difference}"
    return difference


def largest(ours: Any, theirs: Any) -> float:
    """The largest difference, relative to the largest number."""
    ours, theirs = np.asarray(ours, np.float64), np.asarray(theirs, np.float64)
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())
