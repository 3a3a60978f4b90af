"""The figures of a run, as SVG."""

import statistics
from typing import Any

from jotlight.experiments.report.curves import Axes, Line, render_svg
from suite.figures import speed_up

COLOURS = ("#d55e00", "#2f6fb7", "#0f9d74", "#b865a3", "#c98a00", "#8a8f98", "#3f9fdc", "#1d2733")


def curves(found: dict[str, Any]) -> dict[str, str]:
    """SVG by name of file."""
    drawn = {}
    if len(found["threads"]) > 1 and found["paths"]:
        drawn["threads"] = render_svg([threads(found)])
    if "scaling" in found:
        scaling = found["scaling"]
        drawn["sizes"] = render_svg([size_times(scaling), size_memory(scaling)])
        drawn["costs"] = render_svg(
            [
                cost(scaling, "oversampling", "bits per pixel, K = K̂²", lambda side: side**2),
                cost(scaling, "frames", "bits per pixel, K = T", int),
                cost(scaling, "taps", "taps of the filter, a side", int),
            ]
        )
    return drawn


def threads(found: dict[str, Any]) -> Axes:
    numbers = found["threads"]
    # Of the many sensors that bits are drawn for, the first.
    paths = [path for path in found["paths"] if not path["name"].startswith("sampling-")]
    lines = [Line("as many as threads", numbers, numbers, "#5b6876", dashed=True, width=1)]
    for place, path in enumerate(paths):
        times = [speed_up(path, number) for number in numbers]
        title = path["title"].split(",")[0] if path["name"] == "sampling" else path["title"]
        lines.append(Line(title, numbers, times, COLOURS[place % len(COLOURS)], "o"))
    return Axes(lines, "threads", "times as fast as on one", "Threads", x_ticks=numbers)


def size_times(scaling: dict[str, Any]) -> Axes:
    return by_size(scaling, "ns per pixel", "Time, one thread", ns_per_pixel)


def size_memory(scaling: dict[str, Any]) -> Axes:
    title = "Peak memory beyond input and output"
    return by_size(scaling, "MiB", title, lambda row: max(row["beyond"] / 2**20, 0.01))


def by_size(scaling: dict[str, Any], y: str, title: str, value: Any) -> Axes:
    lines = []
    for colour, what in zip(COLOURS, ("reconstruct", "expose"), strict=False):
        rows = [row for row in scaling["sizes"] if row["what"] == what]
        sides, values = [row["side"] for row in rows], [value(row) for row in rows]
        lines.append(Line(what, sides, values, colour, "o"))
    sides = sorted({row["side"] for row in scaling["sizes"]})[::2]
    return Axes(lines, "pixels, a side", y, title, x_log=True, y_log=True, x_ticks=sides)


def ns_per_pixel(row: dict[str, Any]) -> float:
    return 1e9 * statistics.median(row["seconds"]) / row["side"] ** 2


def cost(scaling: dict[str, Any], name: str, x: str, place: Any) -> Axes:
    by_line: dict[str, list[tuple[float, float]]] = {}
    for key, times in scaling[name].items():
        line, number = key.split()
        nanoseconds = 1e9 * statistics.median(times) / scaling["side"] ** 2
        by_line.setdefault(line, []).append((place(int(number)), nanoseconds))
    lines = [
        Line(line, *zip(*points, strict=True), COLOURS[index], "o")
        for index, (line, points) in enumerate(by_line.items())
    ]
    return Axes(lines, x, "ns per pixel, one thread")
