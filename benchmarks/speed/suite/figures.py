"""What follows from the times of a run."""

import statistics
from collections.abc import Sequence
from typing import Any

from suite.probes import MULTIPLY_ADDS, READING

Path = dict[str, Any]
"""A hot path as the JSON has it."""


def median(path: Path, name: str, threads: int) -> float:
    return statistics.median(path["seconds"][str(threads)][name])


def spread(path: Path, name: str, threads: int) -> float:
    """The middle half of the times, as a share of their median."""
    return spread_of(path["seconds"][str(threads)][name])


def spread_of(times: Sequence[float]) -> float:
    if len(times) < 2:
        return 0.0
    low, middle, high = statistics.quantiles(times, n=4, method="inclusive")
    return (high - low) / middle


def ratio(path: Path, name: str, threads: int, to: str = "jotlight") -> float:
    """How many times as long as ours another takes: the median of the rounds' ratios."""
    seconds = path["seconds"][str(threads)]
    return paired(seconds[name], seconds[to])


def paired(above: Sequence[float], below: Sequence[float]) -> float:
    # A slow one has fewer rounds.
    return statistics.median(a / b for a, b in zip(above, below, strict=False))


def speed_up(path: Path, threads: int, name: str = "jotlight") -> float:
    seconds = path["seconds"]
    return paired(seconds["1"][name], seconds[str(threads)][name])


def peak(path: Path, threads: int) -> float:
    """Multiply-adds per second that the machine could do in the same rounds."""
    # A multiply-add is two floating-point operations.
    operations = path["probes"]["operations"][str(threads)] / 2
    return operations / median(path, MULTIPLY_ADDS, threads)


def bandwidth(path: Path, threads: int) -> float:
    """Bytes per second that the machine could read in the same rounds."""
    return path["probes"]["bytes"] / median(path, READING, threads)


def bounds(path: Path, threads: int) -> tuple[float, float]:
    """Seconds that the operations take at least, and the bytes."""
    return path["slots"] / peak(path, threads), path["bytes"] / bandwidth(path, threads)


def of_bound(path: Path, threads: int) -> float:
    """How near to its bound ours is: 1 is as fast as the machine can."""
    return max(bounds(path, threads)) / median(path, "jotlight", threads)


def bound_by(path: Path, threads: int) -> str:
    operations, memory = bounds(path, threads)
    return "operations" if operations >= memory else "memory"
