"""The curves of the page, as SVG."""

import statistics
from collections.abc import Callable
from typing import Any

from jotlight.experiments.report.content import Curves
from jotlight.experiments.report.curves import MUTED_COLOR, Axes, Line, render_svg
from suite.derived import speedup
from suite.scaling import OPERATIONS

COLORS = ("#d55e00", "#2f6fb7", "#0f9d74", "#b865a3", "#c98a00", "#8a8f98", "#3f9fdc", "#1d2733")

MIN_MIB = 0.01
"""The lowest value on the logarithmic axis of memory."""


def thread_curves(run: dict[str, Any]) -> list[Curves]:
    """Return the speed by number of threads, where more than one number was measured."""
    if len(run["threads"]) < 2 or not run["tasks"]:
        return []
    svg = render_svg([_thread_axes(run)])
    return [Curves("speed/threads", "Speed by number of threads", svg)]


def size_curves(scaling: dict[str, Any]) -> Curves:
    """Return time and memory by image size."""
    axes = [
        _size_axes(scaling, "ns per pixel", "Time, one thread", ns_per_pixel),
        _size_axes(scaling, "MiB", "Peak memory in addition to input and output", additional_mib),
    ]
    return Curves("speed/sizes", "Time and memory by image size", render_svg(axes))


def cost_curves(scaling: dict[str, Any]) -> Curves:
    """Return the time by trials per pixel, frames, and filter size."""
    axes = [
        _cost_axes(scaling, "oversampling", "trials per pixel, K = K̂²", lambda side: side**2),
        _cost_axes(scaling, "frames", "trials per pixel, K = T", int),
        _cost_axes(scaling, "taps", "width of the filter", int),
    ]
    return Curves("speed/costs", "Time by bits, frames, and filter size", render_svg(axes))


def _thread_axes(run: dict[str, Any]) -> Axes:
    numbers = run["threads"]
    # One of the many sensors stands for all exposures.
    tasks = [task for task in run["tasks"] if not task["name"].startswith("exposure-")]
    lines = [Line("proportional", numbers, numbers, MUTED_COLOR, style="--", width=1)]
    for index, task in enumerate(tasks):
        times = [speedup(task, number) for number in numbers]
        title = task["title"].split(",")[0] if task["name"] == "exposure" else task["title"]
        lines.append(Line(title, numbers, times, COLORS[index % len(COLORS)], "o"))
    return Axes(lines, "threads", "times as fast as on one", "Threads", x_ticks=numbers)


def ns_per_pixel(row: dict[str, Any]) -> float:
    """Return the time of a size in nanoseconds per pixel."""
    return 1e9 * statistics.median(row["seconds"]) / row["side"] ** 2


def additional_mib(row: dict[str, Any]) -> float:
    """Return the peak memory of a size in addition to input and output."""
    return max(row["additional_bytes"] / 2**20, MIN_MIB)


def _size_axes(
    scaling: dict[str, Any], y_label: str, title: str, value: Callable[[dict[str, Any]], float]
) -> Axes:
    lines = []
    measured = {row["operation"] for row in scaling["sizes"]}
    shown = [operation for operation in OPERATIONS if operation in measured]
    for color, operation in zip(COLORS, shown, strict=False):
        rows = [row for row in scaling["sizes"] if row["operation"] == operation]
        sides, values = [row["side"] for row in rows], [value(row) for row in rows]
        lines.append(Line(operation, sides, values, color, "o"))
    ticks = sorted({row["side"] for row in scaling["sizes"]})[::2]
    label = "image width in pixels"
    return Axes(lines, label, y_label, title, x_log=True, y_log=True, x_ticks=ticks)


def _cost_axes(
    scaling: dict[str, Any], name: str, x_label: str, x_of: Callable[[int], float]
) -> Axes:
    by_line: dict[str, list[tuple[float, float]]] = {}
    for key, times in scaling[name].items():
        line, number = key.split()
        nanoseconds = 1e9 * statistics.median(times) / scaling["side"] ** 2
        by_line.setdefault(line, []).append((x_of(int(number)), nanoseconds))
    lines = [
        Line(line, *zip(*points, strict=True), COLORS[index], "o")
        for index, (line, points) in enumerate(by_line.items())
    ]
    return Axes(lines, x_label, "ns per pixel, one thread")
