"""A task with the programs that do it, and how they are checked and timed."""

import dataclasses
import importlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import jotlight._engine as engine
from suite import probes
from suite.threads import limited
from suite.timing import Effort, Run, race

SCALAR_TOLERANCE = 1e-4
"""Maximum difference of floats from those of scalar code, relative to the largest float."""
OTHER_THREADS = 7
"""A further number of threads for which the result has to be the same."""


OPERATION_FIELDS = "operations", "direct_operations", "multiply_adds", "bytes", "operations_note"


class CannotRunError(Exception):
    """A rival cannot run here. The message says why."""


@dataclasses.dataclass(frozen=True)
class Rival:
    """Another program for the same result, or for the same purpose if `same` is false."""

    name: str
    make: Callable[[Any], Callable[[], Any]]
    """A function that takes the package and returns the function to time."""
    package: str = "numpy"
    same: bool = True
    rounded: bool = False
    """Whether it computes in less precise numbers. Its difference is stated, and not limited."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A task: what is timed, which results have to agree, and how much work it is."""

    name: str
    title: str
    description: str
    items: float
    """How many units of work a call does."""
    unit: str
    """What a unit is, in the plural."""
    run: Callable[[int], Any]
    """jotlight's function. It takes the number of threads."""
    rivals: Sequence[Rival]
    difference: Callable[[Any, Any], float]
    agreement: str
    """What `difference` returns, in words."""
    tolerance: float
    operations: float
    """Multiply-adds, and other operations that take the place of one."""
    bytes: float
    """Bytes that have to be read and written."""
    operations_note: str
    """What counts as operations and bytes."""
    direct_operations: float | None = None
    """Operations with direct convolution, where the engine needs fewer."""
    multiply_adds: dict[str, float] = dataclasses.field(default_factory=dict)
    """Multiply-adds per unit, by who does them."""
    psnr: Callable[[Any], float] | None = None
    """The PSNR of a result in dB, where the result is an image."""
    parts: dict[str, Run] = dataclasses.field(default_factory=dict)
    """Further functions of jotlight that are timed too."""


def measure(case: Case, threads: Sequence[int], effort: Effort) -> dict[str, Any]:
    """Check the results, then time all programs. Return what the JSON keeps.

    Raises
    ------
    AssertionError
        If a rival's result differs by more than the tolerance, or jotlight's differs by number of
        threads or by instruction set.
    """
    result = np.array(case.run(1))
    for number in {*threads, OTHER_THREADS}:
        assert np.array_equal(result, case.run(number)), f"{case.name}: {number} threads differ"
    level_differences = compare_levels(case)
    runs: dict[str, Run] = {"jotlight": case.run, **case.parts}
    found: dict[str, dict[str, float]] = {"differences": {}, "rounded_differences": {}, "psnr": {}}
    if case.psnr:
        found["psnr"]["jotlight"] = case.psnr(result)
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
        for number in threads:
            with limited(number):  # This is the first, slow call.
                record_agreement(case, rival, run(), result, found)
        runs[rival.name] = lambda _, run=run: run()
    return {
        **{
            field: getattr(case, field)
            for field in ("name", "title", "description", "items", "unit", "agreement", "tolerance")
        },
        **{field: getattr(case, field) for field in OPERATION_FIELDS},
        "same_for_threads": sorted({*threads, OTHER_THREADS}),
        "level_differences": level_differences,
        **found,
        "left_out": left_out,
        "probes": probes.work(threads, effort.words),
        "seconds": race({**runs, **probes.runs(effort.words, case.run)}, threads, effort),
    }


def compare_levels(case: Case) -> dict[str, float]:
    """Return how far the result of each instruction set is from that of scalar code."""
    try:
        results = {}
        for level in engine.cpu_levels():
            engine.choose_cpu_level(level)
            results[level] = np.array(case.run(1))
    finally:
        engine.choose_cpu_level(None)
    scalar = results.pop("scalar")
    allowed = 0 if scalar.dtype.kind in "biu" else SCALAR_TOLERANCE
    levels = {level: relative_difference(result, scalar) for level, result in results.items()}
    assert max(levels.values(), default=0) <= allowed, f"{case.name}: {levels}"
    return levels


def record_agreement(
    case: Case, rival: Rival, result: Any, expected: Any, found: dict[str, dict[str, float]]
) -> None:
    """Record the difference of a rival's result and its PSNR: those of its worst result."""
    if not rival.same:
        return
    difference = float(case.difference(expected, result))
    is_near = rival.rounded or difference <= case.tolerance
    assert is_near, f"{case.name}: {rival.name} differs: {difference}"
    differences = found["rounded_differences" if rival.rounded else "differences"]
    differences[rival.name] = max(difference, differences.get(rival.name, 0.0))
    if case.psnr:
        psnr = found["psnr"]
        psnr[rival.name] = min(case.psnr(result), psnr.get(rival.name, np.inf))


def relative_difference(result: Any, expected: Any) -> float:
    """Return the largest difference, relative to the largest number."""
    result, expected = np.asarray(result, np.float64), np.asarray(expected, np.float64)
    return float(np.abs(result - expected).max() / np.abs(expected).max())
