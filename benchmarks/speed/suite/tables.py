"""The tables of the page."""

import statistics
from collections.abc import Sequence
from typing import Any

from jotlight.experiments.report.changes import row_title
from jotlight.experiments.report.content import Column, Table, Value
from suite.comparisons import comparisons
from suite.derived import (
    Task,
    bandwidth,
    bounds,
    limiting_resource,
    median,
    median_ratio,
    peak,
    ratio,
    relative_spread,
    share_of_bound,
    speedup,
    spread,
)
from suite.latency import NUMPY
from suite.probes import MULTIPLY_ADDS, READING, SAME_DURATION
from suite.tasks.two_layer_network import BM3D, TV

NETWORK_USES = {
    "network-two-layer": "video and previews",
    "network-small": "better images within a few milliseconds",
    "network-medium": "most images; it serves any exposure and any number of trials per pixel",
    "network-large": "better images than those of medium",
}
"""When to use each network, by the name of its task."""

RIVAL_USES = {
    TV: "results without training",
    BM3D: "comparison with the literature; its package is for non-commercial use",
}
"""When to use the non-iterative methods, by their name in the task of the two-layer network."""

METHODS = {TV: "noniterative-tv", BM3D: "noniterative-bm3d"}
"""Their names in jotlight."""


def comparison_table(run: dict[str, Any]) -> Table:
    """Return jotlight's time for each task beside the fastest alternative."""
    columns, by_threads = [Column("task")], []
    for threads in run["threads"]:
        word = thread_words(threads)
        columns += [
            Column(f"jotlight, {word}, ms", format_significant),
            Column("fastest alternative"),
            Column("times as fast", format_significant),
        ]
        by_threads.append({each.task: each for each in comparisons(run, threads)})
    rows: list[list[Value]] = []
    for title in by_threads[0] if by_threads else ():
        row: list[Value] = [title]
        for found in by_threads:
            each = found[title]
            row += [1000 * each.seconds, each.alternative, each.ratio]
        rows.append(row)
    return Table("Time of jotlight and of the fastest software for the same work", columns, rows)


def method_table(run: dict[str, Any]) -> Table | None:
    """Return the time of each method for one image, or None if no network was measured."""
    tasks = {task["name"]: task for task in run["tasks"]}
    date = run["machine"]["date"]
    found = [
        (row_title(tasks[name]["title"], name, date, only_time=True), tasks[name], "jotlight", use)
        for name, use in NETWORK_USES.items()
        if name in tasks
    ]
    if not found:
        return None
    two_layer = tasks.get("network-two-layer")
    if two_layer:
        found += [
            (
                row_title(name[0].upper() + name[1:], METHODS[name], date, only_time=True),
                two_layer,
                name,
                use,
            )
            for name, use in RIVAL_USES.items()
            if name in two_layer["seconds"]["1"]
        ]
    threads = run["threads"]
    return Table(
        "Time of each method for an image of 481 × 321 pixels, K = 16",
        [
            Column("method"),
            *(Column(f"{thread_words(number)}, ms", format_significant) for number in threads),
            Column("use it for"),
        ],
        [
            [title, *(1000 * median(task, name, number) for number in threads), use]
            for title, task, name, use in found
        ],
    )


def thread_table(run: dict[str, Any]) -> Table:
    """Return how much faster each task is on all threads than on one."""
    threads = max(run["threads"])
    return Table(
        f"How many times as fast as on one thread each task is on {threads}",
        [
            Column("task"),
            Column("jotlight", ".2f"),
            Column("multiply-adds alone", ".2f"),
            Column("reading alone", ".2f"),
            Column("multiply-adds of the same duration", ".2f"),
        ],
        [
            [
                task["title"],
                speedup(task, threads),
                peak(task, threads) / peak(task, 1),
                bandwidth(task, threads) / bandwidth(task, 1),
                speedup(task, threads, SAME_DURATION),
            ]
            for task in run["tasks"]
        ],
    )


def task_table(task: Task) -> Table:
    """Return times and ratios of all contenders of a task, by number of threads."""
    numbers = [int(number) for number in task["seconds"]]
    columns = [Column("")]
    for number in numbers:
        columns += [
            Column(f"{thread_words(number)}, ms", format_significant),
            Column("spread", ".0%"),
            Column("ratio", format_significant),
        ]
    rows: list[list[Value]] = []
    for name in task["seconds"]["1"]:
        if name not in (MULTIPLY_ADDS, READING, SAME_DURATION):
            row: list[Value] = [name]
            for number in numbers:
                row += [
                    1000 * median(task, name, number),
                    spread(task, name, number),
                    ratio(task, name, number),
                ]
            rows.append(row)
    return Table("Times", columns, rows)


def machine_table(tasks: Sequence[Task], threads: Sequence[int]) -> Table:
    """Return the range of the machine's peaks over the rounds of all tasks."""
    rows: list[list[Value]] = []
    for number in threads:
        gflops = [2 * peak(task, number) / 1e9 for task in tasks]
        gigabytes = [bandwidth(task, number) / 1e9 for task in tasks]
        ranges = [f"{min(values):.1f} to {max(values):.1f}" for values in (gflops, gigabytes)]
        rows.append([thread_words(number), *ranges])
    columns = [Column(""), Column("multiply-adds, Gflop/s"), Column("reading, GB/s")]
    return Table("The machine's peaks", columns, rows)


def roofline_table(tasks: Sequence[Task], threads: Sequence[int]) -> Table:
    """Return the minimum time of each task on this machine beside the measured time."""
    columns = [
        Column("task"),
        Column("unit"),
        Column("operations per unit", format_significant),
        Column("with direct convolution", format_significant),
        Column("bytes per unit", format_significant),
        Column("limited by"),
    ]
    for number in threads:
        columns += [
            Column(f"minimum, {thread_words(number)}, ms", format_significant),
            Column("measured, ms", format_significant),
            Column("share", ".0%"),
        ]
    rows: list[list[Value]] = []
    for task in tasks:
        row: list[Value] = [
            task["title"],
            task["unit"].removesuffix("s"),
            task["operations"] / task["items"],
            (task["direct_operations"] or task["operations"]) / task["items"],
            task["bytes"] / task["items"],
            limiting_resource(task, 1),
        ]
        for number in threads:
            row += [
                1000 * max(bounds(task, number)),
                1000 * median(task, "jotlight", number),
                share_of_bound(task, number),
            ]
        rows.append(row)
    return Table("The minimum times that the machine allows, and the measured times", columns, rows)


def size_table(rows: Sequence[dict[str, Any]]) -> Table:
    """Return time and memory of an exposure and of a reconstruction, by image size."""
    columns = [
        Column("operation"),
        Column("pixels"),
        Column("ms", format_significant),
        Column("ns per pixel", format_significant),
        Column("of these in the program", format_significant),
        Column("additional MiB", ".1f"),
        Column("additional bytes per pixel", format_significant),
    ]
    cells: list[list[Value]] = [
        [
            row["operation"],
            f"{row['side']:,} × {row['side']:,}",
            1000 * statistics.median(row["seconds"]),
            1e9 * statistics.median(row["seconds"]) / row["side"] ** 2,
            1e9 * row["user_seconds"] / row["side"] ** 2,
            row["additional_bytes"] / 2**20,
            row["additional_bytes"] / row["side"] ** 2,
        ]
        for row in rows
    ]
    return Table("Time and memory by image size", columns, cells)


def latency_table(times: dict[str, list[float]]) -> Table:
    """Return the elapsed time of fresh processes."""
    return Table(
        "Elapsed time of a process",
        [
            Column("process"),
            Column("s", ".3f"),
            Column("spread", ".0%"),
            Column("share of Python and NumPy alone", ".0%"),
        ],
        [
            [
                f"`{name}`" if name.startswith("jotlight") else name,
                statistics.median(each),
                relative_spread(each),
                min(1.0, median_ratio(times[NUMPY], each)),
            ]
            for name, each in times.items()
        ],
    )


def thread_words(threads: int) -> str:
    """Return a number of threads in words."""
    return "1 thread" if threads == 1 else f"{threads} threads"


def format_significant(value: float) -> str:
    """Return a number with three significant figures, or as a whole number from 100 on."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
