"""Kill jotlight, fill its disk, flip bits of its files, pass it extreme bits, and record results.

    python tools/robustness/run.py kills|disks|flips|sweep|all [--quick] [--only WORD]
    python tools/robustness/run.py page

The results are lines of JSON in FOLDER/robustness (--output FOLDER), from which `page` makes
FOLDER/robustness.md. The exit status is 1 if a file was damaged, a message was wrong, a flip was
not detected, or an estimate left its range. `fuzz/readers.py --output FILE` and
`fuzz/engine.py --output FILE` add their results to files in the same folder.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from damage import disks, flips, kills
from damage.page import PAGE_FILE, build_page
from damage.record import ROOT, Row, facts, read_rows, report, write_rows
from sweep.measure import measure as measure_sweep

PARTS = {
    "kills": kills.measure,
    "disks": disks.measure,
    "flips": flips.measure,
    "sweep": measure_sweep,
}
COMMAND = "python tools/robustness/run.py"


def main() -> None:
    """Parse the command line, measure the parts, and write their results."""
    options = arguments()
    if options.part == "page":
        print(write_page(options.output))
        return
    names = list(PARTS) if options.part == "all" else [options.part]
    if "disks" in names:
        disks.enter_namespace()
    violations = 0
    for name in names:
        begin = time.monotonic()
        rows = PARTS[name](quick=options.quick, only=options.only)
        found = sum(len(row["violations"]) for row in rows)
        command = f"{COMMAND} {name}" + " --quick" * options.quick
        if options.only:
            command += f" --only {options.only!r}"
        run: Row = {**facts(command), "of": name, "seconds": round(time.monotonic() - begin, 1)}
        folder = options.output / "robustness"
        folder.mkdir(parents=True, exist_ok=True)
        write_rows(folder / f"{name}.jsonl", [run, *rows])
        report(f"{name}: {len(rows)} rows, {found} violations, in {folder / name}.jsonl")
        violations += found
    sys.exit(violations > 0)


def write_page(folder: Path) -> Path:
    """Write the page from the results in a folder, and return its path."""
    (folder / PAGE_FILE).write_text(build_page(read_rows(folder / "robustness")), "utf-8")
    return folder / PAGE_FILE


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=[*PARTS, "all", "page"])
    parser.add_argument(
        "--output",
        type=Path,
        default=Path(tempfile.gettempdir(), "jotlight-robustness"),
        help="folder of the results; that of the repository is docs/results",
    )
    parser.add_argument("--quick", action="store_true", help="a few cases of each part, in seconds")
    parser.add_argument("--only", default="", help="cases whose name contains this word")
    options = parser.parse_args()
    if options.part == "page" and not (options.output / "robustness").is_dir():
        options.output = ROOT / "docs" / "results"
    return options


if __name__ == "__main__":
    main()
