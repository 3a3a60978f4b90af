"""The section of the page of results about the sweep."""

from collections.abc import Sequence
from typing import Any

from .cases import ARRANGEMENTS, FEW_GAINS, GAINS, LONG, PATTERNS, SENSORS, SHAPES, THRESHOLDS
from .methods import SLOW_STRIDE, build_methods

TITLE = "## Extreme bits, exposures, and shapes"

SECTION = """{title}

Every method with all of its options, and every pretrained network of that time, ran on
{patterns} patterns of bits:
{pattern_names}. A finding is a value that is not finite or outside [0, S], another shape or type,
a warning, or any exception. A network may refuse a sensor that it was not trained for, with a
message; the table counts such refusals. The film network, which takes films, is not part of it.

All combinations would take weeks. So the sweep takes all combinations of pattern and method with

- all of {gains} gains from {lowest:g} to {highest:g} and K, and all thresholds {thresholds};
- all of {shapes} shapes from {first} to {last}, and all of {arrangements} numbers of jots and
  frames per pixel, at {few} gains; images of {long} pixels only with the first number of jots and
  frames, at the default gain;
- all of {sensors} kinds of sensors, at {few} gains and 2 thresholds: kernels, S from 1e-18 to 1e18,
  dark counts up to 1e6, dead jots, unequal jots, and color.

A network for one K ran on both square and single jots per pixel with this K. BM3D, which is slow,
ran on every {stride}th combination.{since}

| method | estimates | refused | slowest (s) | findings |
| --- | ---: | ---: | ---: | ---: |
{rows}
| **all** | {runs:,} | {refused:,} | {slowest:.1f} | {violations} |
{findings}"""


def build_section(rows: Sequence[dict[str, Any]]) -> str:
    """Return the section for the rows that `measure` returned."""
    lines = [
        f"| {row['name']} | {row['runs']:,} | {row['refused']:,} | {row['slowest_seconds']:.1f} "
        f"| {len(row['violations'])} |"
        for row in rows
    ]
    findings = [f"- {row['name']}: {text}" for row in rows for text in row["violations"]]
    since = _changes_since({row["name"] for row in rows})
    *others, last = (str(threshold) for threshold in THRESHOLDS)
    return SECTION.format(
        title=TITLE,
        patterns=len(PATTERNS),
        pattern_names=", ".join(PATTERNS),
        gains=len(GAINS),
        lowest=GAINS[0],
        highest=GAINS[-1],
        thresholds=f"{', '.join(others)}, and {last}",
        shapes=len(SHAPES),
        first=" x ".join(map(str, SHAPES[0])),
        last=" x ".join(map(str, SHAPES[-1])),
        arrangements=len(ARRANGEMENTS),
        few=len(FEW_GAINS),
        long=f"{LONG:,}",
        sensors=len(SENSORS),
        stride=SLOW_STRIDE,
        since=f"\n\n{since}" if since else "",
        rows="\n".join(lines),
        runs=sum(row["runs"] for row in rows),
        refused=sum(row["refused"] for row in rows),
        slowest=max(row["slowest_seconds"] for row in rows),
        violations=len(findings),
        findings="\n".join(["", *findings, ""]) if findings else "",
    )


def _changes_since(names: set[str]) -> str:
    """Return which methods the run does not contain, and which networks jotlight no longer has."""
    present = set(build_methods())
    former = {name for name in names - present if name.startswith("network ")}
    sentences = [
        f"{text}: {', '.join(name.removeprefix('network ') for name in sorted(found))}."
        for text, found in (
            ("Methods and networks that were added after this run", present - names),
            ("Networks of this run that jotlight no longer has", former),
        )
        if found
    ]
    return "\n".join(sentences)
