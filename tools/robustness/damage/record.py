"""Results of a run, as lines of JSON."""

import datetime as dt
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[3]

sys.path.append(str(ROOT / "benchmarks" / "speed"))
from suite.machine import commit, version  # noqa: E402

LIBRARIES = ("numpy", "h5py", "zarr", "numcodecs", "scipy", "pillow", "pypng", "tifffile")
"""Libraries that read and write files for jotlight."""

Row = dict[str, Any]


def facts(command: str) -> Row:
    """Return the command, date, commit, system, and versions of software of a run."""
    return {
        "part": "run",
        "command": command,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "commit": commit(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "libraries": {name: version(name) for name in (*LIBRARIES, "torch")},
    }


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as lines of JSON."""
    path.write_text("".join(f"{json.dumps(row)}\n" for row in rows), "utf-8")


def add_row(path: Path, row: Mapping[str, Any]) -> None:
    """Add a row to a file of lines of JSON, with its seconds rounded."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(f"{json.dumps({**row, 'seconds': round(row['seconds'], 1)})}\n")


def read_rows(folder: Path) -> list[Row]:
    """Return the rows of all files of results in a folder."""
    return [
        json.loads(line)
        for path in sorted(folder.glob("*.jsonl"))
        for line in path.read_text("utf-8").splitlines()
    ]


def report(text: str) -> None:
    """Show progress."""
    print(text, file=sys.stderr, flush=True)
