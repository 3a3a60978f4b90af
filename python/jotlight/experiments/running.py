"""Running experiments part by part, so that what is done is never done again."""

import csv
import dataclasses
import datetime as dt
import json
import os
import platform
import re
import shutil
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from jotlight.errors import warn
from jotlight.experiments.experiment import Data, Experiment, Lab, Part, Results, Row
from jotlight.experiments.report.section import Value
from jotlight.files import atomic_write

Facts = dict[str, str]

BM3D = "bm3d"


@dataclasses.dataclass(frozen=True)
class Folder:
    """Where results are kept."""

    path: Path

    @property
    def results(self) -> Path:
        """Tables and figures."""
        return self.path / "results"

    @property
    def page(self) -> Path:
        """The page to look at."""
        return self.path / "report.html"

    def work(self, experiment: Experiment) -> Path:
        """Give the place of the outcomes of an experiment's parts."""
        return self.path / "parts" / experiment.name

    def done(self, experiment: Experiment, part: Part) -> Path:
        """Give the file that says what a part found."""
        return self.work(experiment) / f"{part.name}.json"


def settings_of(experiment: Experiment, quick: bool, data: Data) -> dict[str, Any]:
    """Give what settles an experiment's results, as JSON keeps it."""
    settings = {**(experiment.quick if quick else experiment.full), "quick": quick}
    settings["data"] = {name: data.digest(name) for name in experiment.needs}
    settings["BM3D"] = version(BM3D) if find_spec(BM3D) else "not installed"
    settings["jotlight"] = version("jotlight")
    return dict(json.loads(json.dumps(settings)))


def prepare(
    experiment: Experiment,
    folder: Folder,
    *,
    quick: bool,
    restart: bool,
    data: Data,
    threads: int | None,
) -> Lab:
    """Give the lab of an experiment, with what an earlier run with the same settings left in it.

    Raises
    ------
    ValueError
        When the folder holds results with other settings, and `restart` does not say to forget
        them.
    """
    work = folder.work(experiment)
    settings = settings_of(experiment, quick, data)
    if restart and work.exists():
        shutil.rmtree(work)
    work.mkdir(parents=True, exist_ok=True)
    kept = work / "settings"
    if kept.exists():
        earlier = _read_json(kept, "quick")
        if earlier != settings:
            changed = sorted(
                key for key in earlier | settings if earlier.get(key) != settings.get(key)
            )
            raise ValueError(
                f"{work}: holds results with other settings ({', '.join(changed)}); give another "
                "folder with --output, or forget them with --restart"
            )
    else:
        _write_text(kept, json.dumps(settings, indent=1))
    return Lab(settings, work, data, threads)


def run_part(
    experiment: Experiment, part: Part, folder: Folder, update: Callable[[float], object]
) -> float:
    """Run a part and keep its outcome; gives the seconds that it took."""
    begun = time.perf_counter()
    outcome = part.run(update)
    seconds = time.perf_counter() - begun
    for name, content in outcome.files.items():
        with atomic_write(folder.work(experiment) / name) as temporary:
            temporary.write_bytes(content)
    # Last, since its being there says that the part is done.
    result = {"rows": [_rounded(row) for row in outcome.rows], "seconds": round(seconds, 3)}
    result |= {"date": dt.date.today().isoformat(), "machine": machine()}
    _write_text(folder.done(experiment, part), json.dumps(result))
    return seconds


def gather(experiment: Experiment, lab: Lab, folder: Folder) -> tuple[list[Row], Facts]:
    """Give all rows of an experiment whose parts are done, and what is to be known of its run."""
    rows: list[Row] = []
    seconds = 0.0
    last: dict[str, Any] = {}
    for part in experiment.parts(lab):
        last = _read_json(folder.done(experiment, part), "rows", "seconds", "date", "machine")
        rows += last["rows"]
        seconds += last["seconds"]
    facts = {
        "seconds": f"{seconds:.0f}",
        "date": last["date"],
        "machine": last["machine"],
        "settings": json.dumps(lab.settings),
    }
    return rows, facts


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write rows as CSV."""
    with (
        atomic_write(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read_table(path: Path) -> list[Row]:
    """Read what :func:`write_table` wrote.

    Raises
    ------
    ValueError
        When a row has not as many cells as there are columns.
    """
    rows = [{column: _value(column, cell) for column, cell in row.items()} for row in _cells(path)]
    if not rows:
        raise ValueError(f"{path}: damaged: it has no rows")
    return rows


def _cells(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV, with a cell for each column."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: damaged: expected a CSV file in UTF-8 ({error})") from error
    if any(None in row or None in row.values() for row in rows):
        raise ValueError(f"{path}: damaged: a row has not as many cells as columns")
    return rows


def write_facts(path: Path, facts: dict[str, Facts]) -> None:
    """Write the facts of experiments, and keep those of others that are there."""
    known = read_facts(path) if path.exists() else {}
    rows: list[Row] = [
        {"experiment": experiment, "fact": fact, "value": value}
        for experiment, found in (known | facts).items()
        for fact, value in found.items()
    ]
    write_table(path, rows)


def read_facts(path: Path) -> dict[str, Facts]:
    """Read what :func:`write_facts` wrote."""
    facts: dict[str, Facts] = {}
    for row in _cells(path):
        if row.keys() != {"experiment", "fact", "value"}:
            raise ValueError(
                f"{path}: damaged: expected the columns experiment, fact and value, got "
                f"{', '.join(row)}; run the experiments again (--restart)"
            )
        facts.setdefault(row["experiment"], {})[row["fact"]] = row["value"]
    return facts


def read_results(folder: Path, files: Callable[[str], Path | None]) -> dict[str, Results]:
    """Give the results of all experiments whose tables a folder holds.

    `files` tells where the files of an experiment's parts are. What cannot be read is left out,
    with a warning.
    """
    results: dict[str, Results] = {}
    for name, facts in read_facts(folder / "run.csv").items():
        try:
            rows = read_table(folder / f"{name}.csv")
            settings = json.loads(facts["settings"])
        except (OSError, ValueError, KeyError) as error:
            warn(f"{name} is left out: {error}; run it again")
            continue
        results[name] = Results(settings, rows, files(name), results)
    return results


def machine() -> str:
    """Processor, cores, system and versions, in words."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    packages = ", ".join(f"{name} {version(name)}" for name in ("jotlight", "numpy", "scipy"))
    return (
        f"{processor()}, {cores} cores, {platform.system()}, Python {platform.python_version()}, "
        f"{packages}"
    )


def processor() -> str:
    """Give the name of the processor, as far as the system tells."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = re.findall(r"^model name\s*:\s*(.+)$", info.read_text("utf-8"), re.M)
        if names:
            return str(names[0])
    return platform.processor() or platform.machine()


def _rounded(row: Row) -> Row:
    """Give a row with six digits of each number, which is more than noise lets one know."""
    return {
        key: float(f"{value:.6g}") if isinstance(value, float) else value
        for key, value in row.items()
    }


_WORDS = ("axis", "cores", "estimator", "image", "method")
"""Columns whose cells are words, even where they look like numbers."""


def _value(column: str, cell: str) -> Value:
    if cell == "":
        return None
    if column in _WORDS:
        return cell
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    return cell


def _read_json(path: Path, *keys: str) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text("utf-8"))
    except ValueError:
        found = None
    if not isinstance(found, dict) or not found.keys() >= set(keys):
        raise ValueError(f"{path}: damaged; forget these results with --restart")
    return found


def _write_text(path: Path, text: str) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
