"""Quantities derived from the times of a task: ratios, spreads, and shares of the machine's peak.

A task is a dictionary as `case.measure` returns it and the JSON of a run keeps it. `name` is the
key of a contender in its times: "jotlight", a rival, or a probe of the machine.
"""

import statistics
from collections.abc import Sequence
from typing import Any

from suite.probes import MULTIPLY_ADDS, READING

Task = dict[str, Any]


def median(task: Task, name: str, threads: int) -> float:
    """Return the median seconds of a contender."""
    return statistics.median(task["seconds"][str(threads)][name])


def spread(task: Task, name: str, threads: int) -> float:
    """Return the range of the middle half of a contender's times, as a share of their median."""
    return relative_spread(task["seconds"][str(threads)][name])


def relative_spread(times: Sequence[float]) -> float:
    """Return the range of the middle half of some times, as a share of their median."""
    if len(times) < 2:
        return 0.0
    low, middle, high = statistics.quantiles(times, n=4, method="inclusive")
    return (high - low) / middle


def ratio(task: Task, name: str, threads: int) -> float:
    """Return how many times as long as jotlight a contender takes."""
    seconds = task["seconds"][str(threads)]
    return median_ratio(seconds[name], seconds["jotlight"])


def median_ratio(above: Sequence[float], below: Sequence[float]) -> float:
    """Return the median of the ratios of each round."""
    # A slow contender has fewer rounds.
    return statistics.median(a / b for a, b in zip(above, below, strict=False))


def speedup(task: Task, threads: int, name: str = "jotlight") -> float:
    """Return how many times as fast as on one thread a contender is on several."""
    seconds = task["seconds"]
    return median_ratio(seconds["1"][name], seconds[str(threads)][name])


def peak(task: Task, threads: int) -> float:
    """Return the multiply-adds per second that the machine reached in the same rounds."""
    # A multiply-add is two floating-point operations.
    multiply_adds = task["probes"]["operations"][str(threads)] / 2
    return multiply_adds / median(task, MULTIPLY_ADDS, threads)


def bandwidth(task: Task, threads: int) -> float:
    """Return the bytes per second that the machine read in the same rounds."""
    return task["probes"]["bytes"] / median(task, READING, threads)


def bounds(task: Task, threads: int) -> tuple[float, float]:
    """Return the minimum seconds for the task's operations, and for its bytes."""
    return task["operations"] / peak(task, threads), task["bytes"] / bandwidth(task, threads)


def share_of_bound(task: Task, threads: int) -> float:
    """Return the minimum time as a share of jotlight's. At 1 the machine allows no less time."""
    return max(bounds(task, threads)) / median(task, "jotlight", threads)


def limiting_resource(task: Task, threads: int) -> str:
    """Return "operations" or "memory", whichever takes longer."""
    operations, memory = bounds(task, threads)
    return "operations" if operations >= memory else "memory"


def filter_share_of_peak(task: Task, one_tap: str) -> float:
    """Return the share of the peak that the filter reaches alone, on one thread.

    The time of a filter with one tap, which has the name `one_tap`, is subtracted, and so is the
    multiply-add of that tap.
    """
    seconds = task["seconds"]["1"]
    pairs = zip(seconds["jotlight"], seconds[one_tap], strict=True)
    alone = statistics.median(whole - tap for whole, tap in pairs)
    return (task["operations"] - task["items"]) / peak(task, 1) / alone
