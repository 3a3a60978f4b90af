"""The page about robustness. All of it follows from the lines of JSON in a folder."""

from collections.abc import Iterable, Sequence
from typing import Any

from damage.flips import NO_CHECKSUM, ONLY_VERIFIED, OTHER, REFUSED, SAME
from sweep.page import build_section

PAGE_FILE = "robustness.md"

Rows = Sequence[dict[str, Any]]

INTRODUCTION = """# Robustness

This page shows what happens to jotlight and its files when a file is damaged or hostile, when a
process is killed, when the disk is full, and when light and sensors are extreme. [The guide to
files](../guide/file_formats.md) explains how the files are protected. A program made this page from
[the results](robustness); `python tools/robustness/run.py page` makes it again. A *finding* is a
test whose outcome is not one of those that its section allows.

| part | tests | findings | date | time (s) | software | command |
| --- | ---: | ---: | --- | ---: | --- | --- |
{rows}
"""

FUZZING = """## Hostile files and arguments

A fuzzer changes the bytes of valid files and keeps the changes that reach new code. Each reader
reads the result, or refuses it with an error that names the file. Anything else is a finding: any
other exception, a crash, more than 10 s, or more than 512 MiB. atheris fuzzes the Python readers,
which include the readers inside an archive and behind a checksum. A library that is written in C
may crash. Where jotlight can read in a child process, it must turn the crash into an error, and the
last column counts such inputs.

cargo-fuzz calls the entry points of the engine, which is written in Rust, with hostile arguments:
sizes of 0 and near the maximum, NaN and other extreme floats, shapes that do not match, and
reversed or strided arrays. Each entry point returns a result or an error. Anything else is a
finding: a panic, an overflow, more than 10 s, more than 2 GiB, or a result that depends on the
memory layout or on the number of threads.

After a finding was fixed, the readers whose code changed were fuzzed again from the beginning. The
column "commit" is the version of the code that was fuzzed.

| name | commit | inputs | time (s) | inputs/s | branches | findings | library crashes |
| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |
{rows}
"""

KILLS = """## Killed processes

SIGKILL ended each command at random moments, which are uniform over its duration. After each kill,
the old output must be intact or the new one complete, byte by byte, and no other file may have
changed. Then the same command runs to its end, must write the same output, and must leave no
temporary file. The rows "reconstruct: video" are of a command that is now `jotlight film`.

In a second series, SIGKILL ended each command right before each of its changes to the folder of the
output. No file system renames two files at once. So the column "between" counts the kills that hit
the moment between the renames of a capture and of its JSON file. Then each file is complete, but
they belong to different outputs, which the checksums in the JSON file reveal.

| command and output | random kills | old | new | kills before changes | between | findings |
| --- | ---: | ---: | ---: | ---: | ---: | ---: |
{rows}
{violations}"""

DISKS = """## Full disks

Each command wrote to small disks with a given free space, from 0 bytes to 4096 bytes less than the
output. It must end with status 1 and one line that names the file and the reason, keep the old
output intact, and leave nothing behind. Some outputs fit on the disk
nevertheless, because smaller files replaced larger ones.

| command and output | disks | free space (KiB) | fit | findings |
| --- | ---: | --- | ---: | ---: |
{rows}
{violations}"""

FLIPS = """## Flipped bits

In each capture that has checksums, single bits were flipped at random places in all of its files,
one at a time. `jotlight info --verify` must refuse each damaged capture. Reading alone must refuse
it or return the same content. Only the data of `.npy` are not compared with a checksum when they
are read, because that would take longer than reading.

| capture | files | bytes | flips | refused by `--verify` | refused by reading | same | other |
| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |
{rows}
{violations}
These have no checksums, so their flips cannot be detected: {without}.
"""

FOUND = """## What was found and fixed

| found by | problem | now |
| --- | --- | --- |
{rows}
"""


def build_page(rows: Rows) -> str:
    """Return the page as Markdown."""
    sections = [INTRODUCTION.format(rows=_table(_run_rows(rows)))]
    if fuzzed := _latest(_of(rows, "readers") + _of(rows, "engine")):
        sections.append(FUZZING.format(rows=_table(_fuzz_rows(fuzzed))))
    if kills := _of(rows, "kills"):
        at_changes = _of(rows, "kills at changes")
        table = _table(_kill_rows(kills, at_changes))
        sections.append(KILLS.format(rows=table, violations=_violations(kills + at_changes)))
    if disks := _of(rows, "disks"):
        sections.append(
            DISKS.format(rows=_table(map(_disk_row, disks)), violations=_violations(disks))
        )
    if flips := _of(rows, "flips"):
        without = "; ".join(f"`{name}` ({reason})" for name, reason in NO_CHECKSUM.items())
        sections.append(
            FLIPS.format(
                rows=_table(map(_flip_row, flips)), violations=_violations(flips), without=without
            )
        )
    if sweep := _of(rows, "sweep"):
        sections.append(build_section(sweep))
    if found := _of(rows, "found"):
        cells = ([row["by"], row["problem"], row["now"]] for row in found)
        sections.append(FOUND.format(rows=_table(cells)))
    return "\n".join(section.rstrip("\n") + "\n" for section in sections)


def _of(rows: Rows, part: str) -> list[dict[str, Any]]:
    return [row for row in rows if row["part"] == part]


def _latest(rows: Rows) -> Rows:
    """Return the last row of each name: later runs replace earlier ones."""
    return list({(row["part"], row["name"]): row for row in rows}.values())


def _table(rows: Iterable[Iterable[object]]) -> str:
    return "\n".join(
        f"| {' | '.join(str(cell).replace('|', chr(92) + '|') for cell in row)} |" for row in rows
    )


def _run_rows(rows: Rows) -> Iterable[Iterable[object]]:
    for run in {run["of"]: run for run in _of(rows, "run")}.values():
        of = run["of"]
        found = [row for row in rows if row["part"].startswith(of)]
        found = _latest(found) if of in ("readers", "engine") else found
        keys = {"kills": "kills", "disks": "free", "flips": "flips", "sweep": "runs"}
        counts = (row[keys.get(of, "inputs")] for row in found)
        tests = sum(len(count) if isinstance(count, list) else count for count in counts)
        violations = sum(
            len(row["violations"]) if "violations" in row else row["findings"] for row in found
        )
        software = [f"commit {run['commit']}", f"Python {run['python']}"]
        software += [f"{name} {number}" for name, number in run["libraries"].items() if number]
        seconds = f"{run['seconds']:,.0f}"
        yield (of, f"{tests:,}", violations, run["date"], seconds, ", ".join(software),
               f"`{run['command']}`")  # fmt: skip


def _fuzz_rows(rows: Rows) -> Iterable[Iterable[object]]:
    titles = {"readers": "Python", "engine": "Rust"}
    for row in rows:
        rate = row["inputs"] / max(row["seconds"], 0.1)
        yield (
            f"{titles[row['part']]}: {row['name']}",
            row["commit"],
            f"{row['inputs']:,}",
            f"{row['seconds']:,.0f}",
            f"{rate:,.0f}",
            row["branches"],
            row["findings"],
            row.get("library_crashes", "–"),
        )
    inputs, seconds, findings = (
        sum(row[key] for row in rows) for key in ("inputs", "seconds", "findings")
    )
    yield ("**all**", "", f"{inputs:,}", f"{seconds:,.0f}", "", "", findings, "")


def _kill_rows(kills: Rows, at_changes: Rows) -> Iterable[Iterable[object]]:
    changes = {row["name"]: row for row in at_changes}
    for row in kills:
        other = changes.get(row["name"], {"kills": "–", "violations": []})
        old = row.get("old", 0)
        yield (
            row["name"],
            row["kills"],
            old,
            row["kills"] - old,
            other["kills"],
            other.get("between", "–"),
            len(row["violations"]) + len(other["violations"]),
        )
    total = sum(row["kills"] for row in kills)
    old = sum(row.get("old", 0) for row in kills)
    wrong = sum(len(row["violations"]) for row in (*kills, *at_changes))
    changed, between = (sum(row[key] for row in at_changes) for key in ("kills", "between"))
    yield "**all**", total, old, total - old, changed, between, wrong


def _disk_row(row: dict[str, Any]) -> Iterable[object]:
    free = ", ".join(f"{each // 1024}" for each in row["free"])
    return row["name"], len(row["free"]), free, row["fits"], len(row["violations"])


def _flip_row(row: dict[str, Any]) -> Iterable[object]:
    name = row["name"]
    reads = row.get("reads", {})
    other = row["flips"] - reads.get(REFUSED, 0) - reads.get(SAME, 0)
    note = " (data)" if other and name.startswith(ONLY_VERIFIED) and OTHER in reads else ""
    return (
        name,
        row.get("files", 0),
        row.get("bytes", 0),
        row["flips"],
        row["outcomes"].get(REFUSED, 0),
        reads.get(REFUSED, 0),
        reads.get(SAME, 0),
        f"{other}{note}",
    )


def _violations(rows: Rows) -> str:
    found = [f"- {row['name']}: {text}" for row in rows for text in row["violations"]]
    return "\n".join(["", *found, ""]) if found else ""
