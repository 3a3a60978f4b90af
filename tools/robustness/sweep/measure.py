"""Run every method on all of its cases, and check the range of each estimate."""

import multiprocessing
import os
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from typing import Any

import numpy as np

import jotlight as jl

from .cases import Case, build_cases
from .methods import SweptMethod, build_methods

Row = dict[str, Any]

CASES_PER_TASK = 150
"""Number of cases that a worker runs before it reports."""

STALLED = 900.0
"""Number of seconds without a report of any worker after which the sweep counts as hanging."""

QUICK_STRIDE = 61
"""A quick sweep takes every 61st case: a prime number, so that all settings occur."""


def measure(*, quick: bool, only: str) -> list[Row]:
    """Return a row for each method with its numbers of runs and refusals, and its violations.

    A violation is an estimate that is not finite, lies outside [0, S], or has another shape or
    type, and any exception or warning except the refusal of a sensor by a network.

    Parameters
    ----------
    quick : bool
        Whether to run only every 61st case.
    only : str
        Part of the names of the methods to run; "" selects all.
    """
    stride = QUICK_STRIDE if quick else 1
    names = [name for name in build_methods() if only in name]
    tasks = [(name, stride, part) for name in names for part in range(_parts(name, stride))]
    rows = {name: _empty_row(name) for name in names}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), context) as workers:
        waiting = {workers.submit(run_task, *task): task for task in tasks}
        while waiting:
            done, _ = wait(waiting, STALLED, FIRST_COMPLETED)
            if not done:
                _stop(workers)
                rows[min(waiting.values())[0]]["violations"].append(f"no result in {STALLED:g} s")
                break
            for future in done:
                name, *_ = waiting.pop(future)
                try:
                    _add(rows[name], future.result())
                except BrokenProcessPool:
                    rows[name]["violations"].append("the process ended in a crash")
            print(f"\r{len(tasks) - len(waiting)} of {len(tasks)} tasks", end="", flush=True)
    print()
    return list(rows.values())


def run_task(name: str, stride: int, part: int) -> Row:
    """Return the row for one part of a method's cases."""
    row, method = _empty_row(name), _method(name)
    for case in _cases(name, stride)[part * CASES_PER_TASK : (part + 1) * CASES_PER_TASK]:
        began = time.perf_counter()
        violation, refused = check(method, case)
        seconds = time.perf_counter() - began
        row["seconds"] += seconds
        row["slowest_seconds"] = max(row["slowest_seconds"], seconds)
        row["runs"] += not refused
        row["refused"] += refused
        if violation:
            row["violations"].append(f"{case}: {violation}")
    return row


def check(method: SweptMethod, case: Case) -> tuple[str, bool]:
    """Return what is wrong with an estimate, or "", and whether the network refused the sensor."""
    bits, sensor = case.make()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", jl.JotlightWarning)
            estimate = method.run(bits, sensor)
    except Exception as error:
        # The message of a refusal begins with the argument that the network does not serve.
        if isinstance(error, ValueError) and str(error).startswith("sensor: "):
            return "", True
        return f"{type(error).__name__}: {error}", False
    shape = case.shape if case.channels == 1 else (*case.shape, case.channels)
    if (estimate.shape, estimate.dtype) != (shape, np.float32):
        return f"{estimate.dtype} of shape {estimate.shape}", False
    if not np.isfinite(estimate).all():
        return f"{np.count_nonzero(~np.isfinite(estimate))} values are not finite", False
    low, high = float(estimate.min()), float(estimate.max())
    if low < 0 or high > np.float32(sensor.max_intensity):
        return f"values from {low:g} to {high:g}", False
    return "", False


def _empty_row(name: str) -> Row:
    return {
        "part": "sweep",
        "name": name,
        "runs": 0,
        "refused": 0,
        "seconds": 0.0,
        "slowest_seconds": 0.0,
        "violations": [],
    }


def _add(row: Row, part: Row) -> None:
    for name in "runs", "refused", "seconds", "violations":
        row[name] += part[name]
    row["slowest_seconds"] = max(row["slowest_seconds"], part["slowest_seconds"])


def _parts(name: str, stride: int) -> int:
    return -(-len(_cases(name, stride)) // CASES_PER_TASK)


@cache
def _method(name: str) -> SweptMethod:
    return build_methods()[name]


@cache
def _cases(name: str, stride: int) -> Sequence[Case]:
    method = _method(name)
    return list(build_cases(method.trials))[:: stride * method.stride]


def _stop(workers: ProcessPoolExecutor) -> None:
    """End workers that do not return."""
    for process in (workers._processes or {}).values():
        process.kill()
