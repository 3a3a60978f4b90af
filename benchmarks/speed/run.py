"""Measure every hot path beside its rivals, and write raw JSON and a page of Markdown.

    python benchmarks/speed/run.py [--quick] [--only NAME ...] [--threads 1 2] [--output FOLDER]

The names are those of the hot paths, `scaling` and `latency`. Rivals are in the extra `bench`, but
for BM3D, which is in `bm3d`; one that is not installed is left out, and the page says so.
"""

import argparse
from pathlib import Path

import jotlight._engine as engine
from suite import latency, record, scaling
from suite.case import measure
from suite.machine import ROOT, cores, facts
from suite.paths import PATHS
from suite.timing import FULL, QUICK

OTHERS = ("scaling", "latency")


def main() -> None:
    options = arguments()
    if engine.DEBUG_BUILD:
        raise SystemExit("this is a debug build of jotlight; build it with --release")
    effort = QUICK if options.quick else FULL
    names = options.only or [*PATHS, *OTHERS]
    found: dict[str, object] = {
        "quick": options.quick,
        "threads": options.threads,
        "rounds": effort.rounds,
        "seconds_a_turn": effort.least,
        "machine": facts(),
        "paths": [],
    }
    paths: list[object] = []
    for name in (name for name in PATHS if name in names):
        for case in PATHS[name](options.quick):
            print(case.title, flush=True)
            paths.append(measure(case, options.threads, effort))
    found["paths"] = paths
    for name, part in (
        ("scaling", lambda: scaling.measure(effort, quick=options.quick)),
        ("latency", lambda: latency.measure(effort)),
    ):
        if name in names:
            print(name.capitalize(), flush=True)
            found[name] = part()
    print(f"written: {record.write(found, options.output)}")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="few rounds, small sizes")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=[*PATHS, *OTHERS])
    parser.add_argument("--threads", nargs="+", type=int, default=sorted({1, cores()}))
    parser.add_argument(
        "--output",
        type=Path,
        default=ROOT / "target" / "benchmarks",
        help="folder for speed.md, and speed/ with the JSON and the figures",
    )
    options = parser.parse_args()
    if any(not 1 <= number <= cores() for number in options.threads):
        parser.error(f"--threads: expected 1 to {cores()}, the cores that there are")
    options.threads = sorted({1, *options.threads})
    return options


if __name__ == "__main__":
    main()
