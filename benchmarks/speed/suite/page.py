"""The page about speed, as a report. All of it follows from the JSON of a run."""

import statistics
from collections.abc import Sequence
from typing import Any

from jotlight.experiments.report.changes import changes_since
from jotlight.experiments.report.content import Report, Section
from suite.comparisons import comparisons
from suite.competitors import competitor_sections
from suite.curves import cost_curves, size_curves, thread_curves
from suite.derived import Task, filter_share_of_peak, median, share_of_bound, speedup
from suite.tables import (
    comparison_table,
    format_significant,
    latency_table,
    machine_table,
    method_table,
    roofline_table,
    size_table,
    task_table,
    thread_table,
)
from suite.tasks.filtering import ONE_TAP

COMMAND = "python benchmarks/speed/run.py"
DATA_FILE = "speed/run.json"

MIN_LARGE_SIDE = 512
"""The smallest image width at which the fixed cost of a call hardly matters."""


def build_report(run: dict[str, Any]) -> Report:
    """Return the page of a run."""
    text = (
        "This page shows how fast jotlight is in comparison with other software, and which method "
        "to use for the time that is available."
    )
    if run["quick"]:
        text += " **A quick run with few rounds and small sizes: not for comparison.**"
    if changes := changes_since(run["machine"]["date"]):
        text += f" {changes}"
    tasks: Sequence[Task] = run["tasks"]
    sections = []
    if tasks:
        sections += [
            comparison_section(run),
            *competitor_sections(run, COMMAND),
            *method_sections(run),
            thread_section(run),
        ]
    sections += [*scaling_sections(run), *latency_sections(run)]
    if tasks:
        sections += [limit_section(run), procedure_section(run), *map(task_section, tasks)]
    return Report("Speed", text, machine_facts(run["machine"]), sections)


def machine_facts(machine: dict[str, Any]) -> list[tuple[str, str]]:
    """Return what the run was made on, and with what."""
    packages = [f"{name} {number}" for name, number in machine["packages"].items() if number]
    instructions = ", ".join(machine["instructions"]) or machine["system"]
    load = "" if machine["load"] is None else f"; load at the start: {machine['load']:.1f}"
    return [
        ("Date", f"{machine['date']}, commit {machine['commit'] or 'unknown'}"),
        (
            "Machine",
            f"{machine['processor']} ({instructions}; jotlight uses {machine['level']}), "
            f"{machine['cores']} cores, {machine['memory_gib']:.0f} GiB{load}",
        ),
        (
            "Software",
            f"jotlight {machine['jotlight']}, Python {machine['python']}, {', '.join(packages)}",
        ),
    ]


def command(run: dict[str, Any]) -> str:
    """Return the command that makes the page."""
    return f"{COMMAND}{' --quick' if run['quick'] else ''} --output docs/results"


def comparison_section(run: dict[str, Any]) -> Section:
    """Return jotlight's times beside the fastest alternatives."""
    return Section(
        "comparison",
        "How fast jotlight is",
        f"{headline(run)}Each row of the table is one task. The alternative is the fastest of the "
        "other programs that do the same work; the sections at the end list all programs. The "
        "command that makes this page, and every time that it measured:",
        command(run),
        [DATA_FILE],
        tables=[comparison_table(run)],
    )


def headline(run: dict[str, Any]) -> str:
    """Return the range of ratios on one thread as a sentence, or "" without any."""
    found = comparisons(run, 1)
    if not found:
        return ""
    low, high = (pick(found, key=lambda each: each.ratio) for pick in (min, max))
    return (
        f"On one thread, jotlight is {format_significant(low.ratio)} times ({low.task}) to "
        f"{format_significant(high.ratio)} times ({high.task}) as fast as the fastest alternative. "
    )


def method_sections(run: dict[str, Any]) -> list[Section]:
    """Return the section that tells when to use which method, if networks were measured."""
    table = method_table(run)
    if table is None:
        return []
    return [
        Section(
            "methods",
            "Which method to use",
            "Larger networks are slower and make better images. The PSNR of the networks is in "
            "[their results](networks.md); the PSNR of every method on the paper's images is "
            "in [the reproduction](reproduction.md#which-method-to-pick). The row *changed since* "
            "is that of a method whose time changed after the measurement, and was not measured "
            "since. [Methods](../guide/methods.md) says when to use all others.",
            tables=[table],
        )
    ]


def thread_section(run: dict[str, Any]) -> Section:
    """Return what more threads gain."""
    if max(run["threads"]) == 1:
        return Section("threads", "Threads", "This run used one thread.")
    return Section(
        "threads",
        "Threads",
        "More threads help large images and long captures most, because a short task ends before "
        "all threads have started. The last three columns show what the machine allows: "
        "multiply-adds in registers, reading from memory, and a number of multiply-adds that takes "
        "one thread as long as the task. The system may run two threads on the same core for some "
        "milliseconds, above all on a virtual machine; the measurement moves all threads between "
        "cores, which makes this frequent.",
        tables=[thread_table(run)],
        curves=thread_curves(run),
    )


def scaling_sections(run: dict[str, Any]) -> list[Section]:
    """Return how time and memory grow with the image, the bits, and the filter."""
    if "scaling" not in run:
        return []
    scaling = run["scaling"]
    side = scaling["side"]
    return [
        Section(
            "size",
            "Image size",
            "K = 16, one thread, each size in a process of its own. "
            + fixed_cost(scaling["sizes"])
            + " Memory is in addition to input and output.",
            tables=[size_table(scaling["sizes"])],
            curves=[size_curves(scaling)],
        ),
        Section(
            "costs",
            "Bits, frames, and filter size",
            f"The time of a reconstruction of {side} × {side} pixels on one thread: by K at one "
            "frame, by K at an oversampling of 1, and by the width of the filter at K = 16.",
            curves=[cost_curves(scaling)],
        ),
    ]


def fixed_cost(rows: Sequence[dict[str, Any]]) -> str:
    """Return the time of a call for the smallest image, and the time per pixel of large ones."""
    rows = [row for row in rows if row["operation"] == "reconstruct"]
    fixed = min(statistics.median(row["seconds"]) for row in rows)
    text = f"A reconstruction takes at least {1000 * fixed:.2f} ms."
    large = [row for row in rows if row["side"] >= MIN_LARGE_SIDE]
    if large:
        costs = [1e9 * row["user_seconds"] / row["side"] ** 2 for row in large]
        text += (
            f" From {MIN_LARGE_SIDE} × {MIN_LARGE_SIDE} pixels on, the program takes "
            f"{min(costs):.1f} to {max(costs):.1f} ns per pixel, and the system adds time for new "
            "pages of memory."
        )
    return text


def latency_sections(run: dict[str, Any]) -> list[Section]:
    """Return how long commands take from start to end."""
    if "latency" not in run:
        return []
    return [
        Section(
            "latency",
            "Commands",
            "Elapsed time of fresh processes, in turns. The reconstruction is of an image of "
            "481 × 321 pixels, K = 16.",
            tables=[latency_table(run["latency"])],
        )
    ]


def limit_section(run: dict[str, Any]) -> Section:
    """Return how close each task is to what the machine allows."""
    tasks, threads = run["tasks"], run["threads"]
    mebibytes = tasks[0]["probes"]["bytes"] >> 20
    text = (
        "The minimum time of a task is the longer of two: the time of its operations at the "
        "machine's peak, and the time of its bytes at the machine's bandwidth. The peaks are "
        f"measured in the same rounds: multiply-adds in registers, and reading {mebibytes} MiB. An "
        "operation is a multiply-add, or another operation on 32 bits that takes its place. Data "
        "in the caches can be read faster than the bandwidth."
    )
    for task in tasks:
        if ONE_TAP in task["seconds"]["1"]:
            text += (
                f" The filter alone, without the splines of its forward pass, reaches "
                f"{filter_share_of_peak(task, ONE_TAP):.0%} of the peak on one thread; the whole "
                f"pass reaches {share_of_bound(task, 1):.0%}."
            )
    notes: dict[str, str] = {}
    for task in tasks:
        notes.setdefault(task["operations_note"], task["title"])
    return Section(
        "limits",
        "What the machine allows",
        text,
        tables=[machine_table(tasks, threads), roofline_table(tasks, threads)],
        notes=[f"{title}: {note}." for note, title in notes.items()],
    )


def procedure_section(run: dict[str, Any]) -> Section:
    """Return how the times are measured."""
    threads = max(run["threads"])
    return Section(
        "procedure",
        "How the times are measured",
        f"All programs of a task take turns, in {run['rounds']} rounds, on one thread"
        f"{f' and on {threads}' if threads > 1 else ''}. Programs that take longer than a second "
        "have fewer rounds. A turn has one call that is not counted, and then calls for "
        f"{1000 * run['seconds_per_turn']:.0f} ms, whose mean is one time. Tables show medians of "
        "these times. A ratio is the median of the ratios of each round. The spread is the range "
        "of the middle half of the times. All threads of a program share as many cores as it has "
        "threads. No time counts unless the results agree within the tolerance. "
        + same_results(run["tasks"]),
        notes=left_out(run["tasks"]),
    )


def same_results(tasks: Sequence[Task]) -> str:
    """Return on how many threads the result of each task was the same."""
    titles: dict[str, list[str]] = {}
    for task in tasks:
        numbers = " and ".join(", ".join(map(str, task["same_for_threads"])).rsplit(", ", 1))
        titles.setdefault(numbers, []).append(task["title"])
    if len(titles) == 1:
        return f"The result of every task is the same on {next(iter(titles))} threads."
    each = "; ".join(f"{numbers}: {', '.join(found)}" for numbers, found in titles.items())
    return f"The results are the same on these numbers of threads: {each}."


def task_section(task: Task) -> Section:
    """Return the times of all programs for one task."""
    threads = max(int(number) for number in task["seconds"])
    rate = format_significant(task["items"] / median(task, "jotlight", 1))
    text = f"{task['description']} jotlight does {rate} {task['unit']} per second on one thread"
    if threads > 1:
        text += f", and {speedup(task, threads):.2f} times as many on {threads}"
    return Section(
        task["name"], task["title"], f"{text}.{agreement(task)}", tables=[task_table(task)]
    )


def agreement(task: Task) -> str:
    """Return how far results differ by instruction set, and from those of rivals."""
    text = ""
    if task["level_differences"]:
        each = ", ".join(f"{name} {value:.1e}" for name, value in task["level_differences"].items())
        text += f" Largest relative difference from scalar code: {each}."
    if task["differences"]:
        each = ", ".join(f"{name} {value:.1e}" for name, value in task["differences"].items())
        text += f" {task['agreement'].capitalize()} (tolerance {task['tolerance']:g}): {each}."
    return text


def left_out(tasks: Sequence[Task]) -> list[str]:
    """Return the programs that could not be measured, and why."""
    return [
        f"{task['title']}: {name} is left out because {reason}."
        for task in tasks
        for name, reason in task["left_out"].items()
    ]
