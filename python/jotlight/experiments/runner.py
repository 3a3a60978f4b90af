"""Running an experiment part by part. A finished part never runs again in the same run."""

import dataclasses
import datetime as dt
import json
import math
import os
import platform
import re
import shutil
import time
from collections.abc import Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from jotlight.datasets.fetch import Progress
from jotlight.evaluation.own_method import checksum_of_module
from jotlight.experiments.experiment import Data, Experiment, Part, Row, RunContext
from jotlight.experiments.tables import Facts
from jotlight.files import remove_leftovers, write_file

BM3D = "bm3d"

_FINISHED = "finished"
"""Name of the file that marks a finished run."""


@dataclasses.dataclass(frozen=True)
class Folder:
    """The folder of a reproduction."""

    path: Path

    @property
    def results(self) -> Path:
        """The folder of tables, curves, and the Markdown page."""
        return self.path / "results"

    @property
    def page(self) -> Path:
        """The HTML page."""
        return self.path / "report.html"

    def parts(self, experiment: str) -> Path:
        """Return the folder with the outcomes of an experiment's parts."""
        return self.path / "parts" / experiment

    def part_file(self, experiment: Experiment, part: Part) -> Path:
        """Return the file with a part's rows. It exists if and only if the part is finished."""
        return self.parts(experiment.name) / f"{part.name}.json"


def settings_of(
    experiment: Experiment, quick: bool, data: Data, own: Sequence[str] = ()
) -> dict[str, Any]:
    """Return everything that determines an experiment's results, as JSON keeps it.

    Functions of the caller are identified by a checksum of their modules.
    """
    settings = {
        **(experiment.quick_settings if quick else experiment.full_settings),
        "quick": quick,
    }
    settings["data"] = {name: data.digest(name) for name in experiment.datasets}
    settings["BM3D"] = version(BM3D) if find_spec(BM3D) else "not installed"
    settings["jotlight"] = version("jotlight")
    if own:
        settings["methods"] = {name: checksum_of_module(name) for name in own}
    return dict(json.loads(json.dumps(settings)))


def prepare(
    experiment: Experiment,
    folder: Folder,
    *,
    quick: bool,
    restart: bool,
    data: Data,
    threads: int | None,
    own: Sequence[str] = (),
) -> RunContext:
    """Return the context for an experiment's parts, and keep what an earlier run finished.

    A finished run with functions of the caller is discarded: they may read files or import modules
    that have changed. Only their own modules are compared when an interrupted run continues.

    Raises
    ------
    ValueError
        If the folder holds results with other settings and `restart` is false.
    """
    parts = folder.parts(experiment.name)
    own = own if experiment.compares_methods else ()
    settings = settings_of(experiment, quick, data, own)
    if restart and parts.exists():
        shutil.rmtree(parts)
    parts.mkdir(parents=True, exist_ok=True)
    for path in parts.glob("[!.]*"):
        remove_leftovers(path)
    kept = parts / "settings"
    if kept.exists():
        earlier = _read_json(kept, "quick")
        if earlier != settings:
            changed = sorted(
                key for key in earlier | settings if earlier.get(key) != settings.get(key)
            )
            raise ValueError(
                f"{parts}: holds results with other settings ({', '.join(changed)}); choose "
                "another folder with --output, or delete them with --restart"
            )
        if own and (parts / _FINISHED).exists():
            shutil.rmtree(parts)
            parts.mkdir()
    if not kept.exists():
        write_file(kept, json.dumps(settings, indent=1))
    return RunContext(settings, parts, data, threads, own)


def finish(context: RunContext) -> None:
    """Mark the run of an experiment as finished, after the run of all experiments."""
    write_file(context.folder / _FINISHED, "")


def run_part(experiment: Experiment, part: Part, folder: Folder, progress: Progress) -> float:
    """Run a part and return its seconds. The folder keeps its result."""
    start = time.perf_counter()
    result = part.run(progress)
    seconds = time.perf_counter() - start
    for name, content in result.files.items():
        write_file(folder.parts(experiment.name) / name, content)
    # This file comes last, because it marks the part as finished.
    outcome = {"rows": [_rounded(row) for row in result.rows], "seconds": round(seconds, 3)}
    outcome |= {"date": dt.date.today().isoformat(), "machine": machine()}
    write_file(folder.part_file(experiment, part), json.dumps(outcome))
    return seconds


def collect(experiment: Experiment, context: RunContext, folder: Folder) -> tuple[list[Row], Facts]:
    """Return all rows of an experiment whose parts are finished, and the facts of its run."""
    rows: list[Row] = []
    seconds = 0.0
    last: dict[str, Any] = {}
    for part in experiment.parts(context):
        path = folder.part_file(experiment, part)
        last = _read_outcome(path)
        rows += last["rows"]
        seconds += last["seconds"]
    facts = {
        "seconds": f"{seconds:.0f}",
        "date": last["date"],
        "machine": last["machine"],
        "settings": json.dumps(context.settings),
    }
    return rows, facts


def machine() -> str:
    """Return processor, number of cores, system, and versions as text."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    packages = ", ".join(f"{name} {version(name)}" for name in ("jotlight", "numpy", "scipy"))
    return (
        f"{processor()}, {cores} cores, {platform.system()}, Python {platform.python_version()}, "
        f"{packages}"
    )


def processor() -> str:
    """Return the name of the processor, as far as the system reports it."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = re.findall(r"^model name\s*:\s*(.+)$", info.read_text("utf-8"), re.M)
        if names:
            return str(names[0])
    return platform.processor() or platform.machine()


def _rounded(row: Row) -> Row:
    """Return a row with six digits of each number, which is finer than the noise."""
    return {
        key: float(f"{value:.6g}") if isinstance(value, float) else value
        for key, value in row.items()
    }


def _read_outcome(path: Path) -> dict[str, Any]:
    """Return what :func:`run_part` wrote."""
    outcome = _read_json(path, "rows", "seconds", "date", "machine")
    rows = outcome["rows"]
    if (
        not (isinstance(rows, list) and all(isinstance(row, dict) for row in rows))
        or type(outcome["seconds"]) not in (int, float)
        or not math.isfinite(outcome["seconds"])
        or not all(isinstance(outcome[key], str) for key in ("date", "machine"))
    ):
        raise ValueError(f"{path}: damaged; delete these results with --restart")
    return outcome


def _read_json(path: Path, *keys: str) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text("utf-8"))
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or not content.keys() >= set(keys):
        raise ValueError(f"{path}: damaged; delete these results with --restart")
    return content
