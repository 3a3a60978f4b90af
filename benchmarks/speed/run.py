"""Time jotlight's tasks beside other programs, and write raw JSON and a page of Markdown.

    python benchmarks/speed/run.py [--quick] [--only NAME ...] [--threads 1 2] [--output FOLDER]

The names are those of the tasks, `scaling`, and `latency`. The extra `bench` installs the other
programs, and the extra `bm3d` installs BM3D. A program that is not installed is left out: one line
of the output and of the page says so.
"""

import argparse
from pathlib import Path
from typing import Any

from jotlight._engine import DEBUG_BUILD
from suite import latency, record, scaling
from suite.case import measure
from suite.machine import ROOT, cores, facts
from suite.page import left_out
from suite.tasks import TASKS
from suite.timing import FULL, QUICK

OTHERS = ("scaling", "latency")


def main() -> None:
    options = arguments()
    if DEBUG_BUILD:
        raise SystemExit("this is a debug build of jotlight; build it with --release")
    effort = QUICK if options.quick else FULL
    names = options.only or [*TASKS, *OTHERS]
    machine = facts()  # The load is that before the run.
    tasks: list[dict[str, Any]] = []
    for name in (name for name in TASKS if name in names):
        for case in TASKS[name](options.quick):
            print(case.title, flush=True)
            tasks.append(measure(case, options.threads, effort))
            for line in left_out(tasks[-1:]):
                print(line, flush=True)
    run: dict[str, object] = {
        "quick": options.quick,
        "threads": options.threads,
        "rounds": effort.rounds,
        "seconds_per_turn": effort.min_seconds,
        "machine": machine,
        "tasks": tasks,
    }
    for name, part in (
        ("scaling", lambda: scaling.measure(effort, quick=options.quick)),
        ("latency", lambda: latency.measure(effort)),
    ):
        if name in names:
            print(name.capitalize(), flush=True)
            run[name] = part()
    print(f"written: {record.write(run, options.output)}")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="few rounds, small sizes")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=[*TASKS, *OTHERS])
    parser.add_argument("--threads", nargs="+", type=int, default=sorted({1, cores()}))
    parser.add_argument(
        "--output",
        type=Path,
        default=ROOT / "target" / "benchmarks",
        help="folder for speed.md, and speed/ with the JSON and the curves",
    )
    options = parser.parse_args()
    if any(not 1 <= number <= cores() for number in options.threads):
        parser.error(f"--threads: expected 1 to {cores()}, the number of cores")
    options.threads = sorted({1, *options.threads})
    return options


if __name__ == "__main__":
    main()
