"""Tables of Markdown."""

from collections.abc import Sequence
from typing import Any

from suite.claims import Claim
from suite.figures import (
    Path,
    bandwidth,
    bound_by,
    bounds,
    median,
    of_bound,
    peak,
    ratio,
    speed_up,
    spread,
)
from suite.probes import AS_LONG, MULTIPLY_ADDS, READING


def table(head: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> list[str]:
    """The first `words` columns hold words, the others numbers."""
    rule = ["---" if place < words else "---:" for place in range(len(head))]
    return ["| " + " | ".join(row) + " |" for row in (head, rule, *rows)]


def claims_table(claims: Sequence[Claim]) -> list[str]:
    rows = [
        [claim.said, wanted(claim), amount(claim.measured, claim.unit), claim.verdict, claim.bound]
        for claim in claims
    ]
    lines = table(["what", "wanted", "measured", "", "what bounds it"], rows)
    lines[1] = "| --- | ---: | ---: | --- | --- |"
    return lines


def wanted(claim: Claim) -> str:
    return ("at most " if claim.at_most else "at least ") + amount(claim.wanted, claim.unit)


def amount(value: float | None, unit: str) -> str:
    if value is None:
        return ""
    if unit == "%":
        return f"{value:.0%}"
    return f"{short(value)}{' ' if unit else ''}{unit}"


def short(value: float) -> str:
    """Three figures, and whole numbers above."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def rivals_table(path: Path) -> list[str]:
    """Times and ratios of all contenders, by number of threads."""
    numbers = [int(number) for number in path["seconds"]]
    head = [""]
    for number in numbers:
        head += [f"{threads_in_head(number)}, ms", "spread", "ratio"]
    rows = []
    for name in path["seconds"]["1"]:
        if name not in (MULTIPLY_ADDS, READING, AS_LONG):
            row = [name]
            for number in numbers:
                row += [
                    short(1000 * median(path, name, number)),
                    f"{spread(path, name, number):.0%}",
                    short(ratio(path, name, number)),
                ]
            rows.append(row)
    return table(head, rows)


def threads_in_head(number: int) -> str:
    return "1 thread" if number == 1 else f"{number} threads"


def machine_table(paths: Sequence[Path], threads: Sequence[int]) -> list[str]:
    """The machine's peaks: the least and the most that was seen beside any path."""
    rows = []
    for number in threads:
        peaks = [2 * peak(path, number) / 1e9 for path in paths]
        widths = [bandwidth(path, number) / 1e9 for path in paths]
        rows.append(
            [threads_in_head(number)]
            + [f"{min(values):.1f} to {max(values):.1f}" for values in (peaks, widths)]
        )
    return table(["", "multiply-adds, Gflop/s", "reading, GB/s"], rows)


def roofline_table(paths: Sequence[Path], threads: Sequence[int]) -> list[str]:
    head = ["path", "operations", "bytes", "bound by"]
    for number in threads:
        head += [f"bound, {threads_in_head(number)}, ms", "measured, ms", "share of the bound"]
    rows = []
    for path in paths:
        items = path["items"]
        row = [
            path["title"],
            f"{short(path['slots'] / items)} / {singular(path)}",
            f"{short(path['bytes'] / items)} / {singular(path)}",
            bound_by(path, 1),
        ]
        for number in threads:
            row += [
                short(1000 * max(bounds(path, number))),
                short(1000 * median(path, "jotlight", number)),
                f"{of_bound(path, number):.0%}",
            ]
        rows.append(row)
    return table(head, rows)


def singular(path: Path) -> str:
    return str(path["unit"]).removesuffix("s")


def speed_up_words(path: Path, most: int) -> str:
    rate = path["items"] / median(path, "jotlight", 1)
    words = f"{short(rate)} {path['unit']} per second on one thread"
    if most > 1:
        words += f"; {speed_up(path, most):.2f} times as many on {most}"
    return words


def left_out(paths: Sequence[dict[str, Any]]) -> list[str]:
    return [
        f"- {path['title']}: {name} is left out, {why}."
        for path in paths
        for name, why in path["left_out"].items()
    ]
