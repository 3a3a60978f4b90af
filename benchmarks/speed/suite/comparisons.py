"""Comparisons of jotlight with other software: the fastest alternative for each task."""

import dataclasses
from collections.abc import Sequence
from typing import Any

from suite.derived import Task, median, ratio
from suite.tasks import counting, deep_rivals, exposure, filtering, first_layer, splines, training
from suite.tasks.two_layer_network import COMPILED, TORCH

ALTERNATIVES = {
    "counting": (counting.NUMPY,),
    "first-layer": (first_layer.NUMPY, first_layer.TORCH),
    "filter": (filtering.OPENCV, filtering.TORCH, filtering.FOURIER, filtering.NDIMAGE),
    "splines": (splines.NUMPY, splines.SCIPY, splines.TORCH),
    "network-two-layer": (TORCH, COMPILED),
    "network": deep_rivals.SAME_RESULT,
    "training": (training.TORCH, training.TORCH_BITS),
    "exposure": (exposure.NUMPY,),
}
"""Software that does the same work without jotlight, by the first part of the task's name."""


@dataclasses.dataclass(frozen=True)
class Comparison:
    """The time of jotlight for a task beside that of the fastest alternative."""

    task: str
    threads: int
    seconds: float
    """jotlight's time."""
    alternative: str
    ratio: float
    """How many times as long the alternative takes."""


def compare(task: Task, threads: int) -> Comparison | None:
    """Return the comparison with the fastest alternative, or None if none was measured."""
    times = task["seconds"].get(str(threads), {})
    names = [name for name in alternatives(task) if name in times]
    if not names:
        return None
    fastest = min(names, key=lambda name: median(task, name, threads))
    return Comparison(
        task["title"],
        threads,
        median(task, "jotlight", threads),
        fastest,
        ratio(task, fastest, threads),
    )


def alternatives(task: Task) -> Sequence[str]:
    """Return the names of a task's alternatives."""
    key = next((key for key in ALTERNATIVES if task["name"].startswith(key)), None)
    return ALTERNATIVES[key] if key else ()


def comparisons(run: dict[str, Any], threads: int) -> list[Comparison]:
    """Return a comparison for each task of a run that has an alternative."""
    found = (compare(task, threads) for task in run["tasks"])
    return [comparison for comparison in found if comparison is not None]
