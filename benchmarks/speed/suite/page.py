"""The page: all of it follows from the JSON."""

import statistics
from typing import Any

from suite.claims import claims
from suite.curves import curves, ns_per_pixel
from suite.figures import spread_of
from suite.tables import (
    claims_table,
    left_out,
    machine_table,
    rivals_table,
    roofline_table,
    short,
    speed_up_words,
    table,
)

COMMAND = "python benchmarks/speed/run.py"
LARGE = 512
"""Pixels along a side from which on what a call does at any size matters little."""


def page(found: dict[str, Any]) -> str:
    sections = [head(found), shown(found)]
    if found["paths"]:
        sections += [hot_paths(found), roofline(found)]
    sections += [scaling(found), latency(found)]
    return "\n".join(line for section in sections for line in [*section, ""]).rstrip() + "\n"


def head(found: dict[str, Any]) -> list[str]:
    machine = found["machine"]
    packages = [f"{name} {number}" for name, number in machine["packages"].items() if number]
    quick = " --quick" if found["quick"] else ""
    return [
        "# Benchmarks",
        "",
        f"Made by `{COMMAND}{quick} --output docs/results` from [what it measured]"
        "(speed/run.json), "
        "every single time. "
        + ("**Few rounds and small sizes: not for comparison.**" if found["quick"] else ""),
        "",
        f"- {machine['date']}, commit {machine['commit'] or 'unknown'}, "
        f"jotlight {machine['jotlight']}, Python {machine['python']}",
        f"- {machine['processor']} ({', '.join(machine['instructions']) or machine['system']}; "
        f"{machine['level']} is used), "
        f"{machine['cores']} cores, {machine['memory_gib']:.0f} GiB{at_load(machine)}",
        f"- {', '.join(packages)}",
        "",
        f"All contenders of a path take turns, {found['rounds']} rounds of them, on one thread and "
        f"on {found['threads'][-1]}; those that take longer than a second have fewer. A turn has a "
        f"call that is not counted, and then calls for {1000 * found['seconds_a_turn']:.0f} ms, "
        "whose mean is one time. Figures are medians, ratios the medians of the rounds' own "
        "ratios, and the spread is that of the middle half. All threads of a contender share as "
        "many cores as it has threads. Before anything is timed, results have to agree.",
    ]


def at_load(machine: dict[str, Any]) -> str:
    load = machine["load"]
    return "" if load is None else f"; load when the run began: {load:.1f}"


def shown(found: dict[str, Any]) -> list[str]:
    return ["## What must be shown", "", *claims_table(claims(found))]


def hot_paths(found: dict[str, Any]) -> list[str]:
    lines = ["## Hot paths", ""]
    most = max(found["threads"])
    for path in found["paths"]:
        lines += [f"### {path['title']}", "", f"{path['words']} {speed_up_words(path, most)}.", ""]
        lines += [*rivals_table(path), "", agreement(path), ""]
    absent = left_out(found["paths"])
    return [*lines, "**Left out.**", "", *absent] if absent else lines[:-1]


def agreement(path: dict[str, Any]) -> str:
    threads = ", ".join(map(str, path["same_for_threads"]))
    levels = ", ".join(f"{name} {value:.1e}" for name, value in path["levels"].items())
    words = f"The same on {threads} threads."
    if levels:
        words += f" Largest difference from scalar code relative to its largest value: {levels}."
    if path["differences"]:
        each = ", ".join(f"{name} {value:.1e}" for name, value in path["differences"].items())
        words += f" {path['agreement'].capitalize()}, {path['tolerance']:g} allowed: {each}."
    return words


def roofline(found: dict[str, Any]) -> list[str]:
    paths, threads = found["paths"], found["threads"]
    lines = [
        "## Roofline",
        "",
        "What the machine could do in the very same rounds: multiply-adds in registers, and "
        f"reading {paths[0]['probes']['bytes'] >> 20} MiB; from the least to the most beside any "
        "path.",
        "",
        *machine_table(paths, threads),
        "",
        "Each path's bound is the longer of its operations at that peak and its bytes at that "
        "bandwidth. An operation is a multiply-add, or another on 32 bits that takes the place of "
        "one. What fits in the caches can be faster than its bound by memory.",
        "",
        *roofline_table(paths, threads),
        "",
    ]
    counted: dict[str, list[str]] = {}
    for path in paths:
        counted.setdefault(path["counted"], []).append(path["title"])
    return lines + [f"- {titles[0]}: {words}." for words, titles in counted.items()]


def scaling(found: dict[str, Any]) -> list[str]:
    drawn = curves(found)
    if not drawn:
        return []
    lines = ["## Scaling", ""]
    if "threads" in drawn:
        lines += ["![Speed by number of threads](speed/threads.svg)", ""]
    if "sizes" not in drawn:
        return lines[:-1]
    rows = found["scaling"]["sizes"]
    lines += ["![Time and memory by size](speed/sizes.svg)", "", *flatness(rows), ""]
    lines += [*sizes_table(rows), "", "![Cost by bits, frames and taps](speed/costs.svg)", ""]
    side = found["scaling"]["side"]
    return [
        *lines,
        f"A whole reconstruction of {side} × {side} pixels on one thread, against K by "
        "oversampling, against K by frames, and against the size of the filter at K = 16.",
    ]


def flatness(rows: list[dict[str, Any]]) -> list[str]:
    """What a pixel costs, and what a call does whatever its size."""
    cells = [row for row in rows if row["what"] == "reconstruct"]
    fixed = min(statistics.median(row["seconds"]) for row in cells)
    large = [row for row in cells if row["side"] >= LARGE]
    words = (
        "K = 16, one thread, each size in a process of its own. A reconstruction takes "
        f"{1000 * fixed:.2f} ms at least."
    )
    if large:
        costs = [1e9 * row["own"] / row["side"] ** 2 for row in large]
        words += (
            f" From {LARGE} × {LARGE} pixels on, each takes the program {min(costs):.1f} to "
            f"{max(costs):.1f} ns, besides what the system does for new pages of memory."
        )
    return [words]


def sizes_table(rows: list[dict[str, Any]]) -> list[str]:
    cells = [
        [
            row["what"],
            f"{row['side']:,} × {row['side']:,}",
            short(1000 * statistics.median(row["seconds"])),
            short(ns_per_pixel(row)),
            short(1e9 * row["own"] / row["side"] ** 2),
            f"{row['beyond'] / 2**20:.1f}",
            short(row["beyond"] / row["side"] ** 2),
        ]
        for row in rows
    ]
    head = ["", "pixels", "ms", "ns per pixel", "ns of the program's own"]
    head += ["MiB beyond", "bytes per pixel beyond"]
    return table(head, cells, words=2)


def latency(found: dict[str, Any]) -> list[str]:
    if "latency" not in found:
        return []
    rows = [
        [
            f"`{name}`" if name.startswith("jotlight") else name,
            f"{statistics.median(times):.3f}",
            f"{spread_of(times):.0%}",
        ]
        for name, times in found["latency"].items()
    ]
    words = "Wall time of fresh processes, in turns; the picture is of 481 × 321 pixels, K = 16."
    return ["## Latency", "", words, "", *table(["", "s", "spread"], rows)]
