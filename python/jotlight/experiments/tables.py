"""CSV files of an experiment's rows and of the facts about each run."""

import csv
import datetime as dt
import json
import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from jotlight.errors import warn
from jotlight.experiments.experiment import Results, Row
from jotlight.experiments.report.content import Value
from jotlight.files import atomic_write

Facts = dict[str, str]
"""Seconds, date, machine, and settings of an experiment's run."""

_TEXT_COLUMNS = ("axis", "cores", "estimator", "image", "method")
"""Columns whose cells stay text, even where they look like numbers."""


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
    """Return the rows that :func:`write_table` wrote.

    Raises
    ------
    ValueError
        If a row has more or fewer cells than there are columns, or there are no rows.
    """
    rows = [
        {column: parse_cell(column, cell) for column, cell in row.items()}
        for row in _read_cells(path)
    ]
    if not rows:
        raise ValueError(f"{path}: damaged: it has no rows")
    return rows


def parse_cell(column: str, cell: str) -> Value:
    """Return a cell as None, an int, a float, or text.

    Examples
    --------
    >>> parse_cell("psnr", "25.5"), parse_cell("image", "101085"), parse_cell("sigma", "")
    (25.5, '101085', None)
    """
    if cell == "":
        return None
    if column in _TEXT_COLUMNS:
        return cell
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    return cell


def _read_cells(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV, with a cell for each column."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: damaged: expected a CSV file in UTF-8 ({error})") from error
    if any(None in row or None in row.values() for row in rows):
        raise ValueError(f"{path}: damaged: a row does not have as many cells as columns")
    return rows


def write_facts(path: Path, facts: dict[str, Facts]) -> None:
    """Write the facts of experiments and keep those of others that the file holds."""
    known = read_facts(path) if path.exists() else {}
    rows: list[Row] = [
        {"experiment": experiment, "fact": fact, "value": value}
        for experiment, found in (known | facts).items()
        for fact, value in found.items()
    ]
    write_table(path, rows)


def read_facts(path: Path) -> dict[str, Facts]:
    """Return the facts that :func:`write_facts` wrote, by experiment.

    Raises
    ------
    ValueError
        If the file has other columns.
    """
    facts: dict[str, Facts] = {}
    for row in _read_cells(path):
        if row.keys() != {"experiment", "fact", "value"}:
            raise ValueError(
                f"{path}: damaged: expected the columns experiment, fact and value, got "
                f"{', '.join(row)}; run the experiments again (--restart)"
            )
        facts.setdefault(row["experiment"], {})[row["fact"]] = row["value"]
    return facts


def read_results(folder: Path, files: Callable[[str], Path | None]) -> dict[str, Results]:
    """Return the results of all experiments whose tables a folder holds.

    An experiment whose table or facts are damaged is left out, with a warning.

    Parameters
    ----------
    folder : Path
        The folder with ``run.csv`` and a CSV for each experiment.
    files : callable
        Takes an experiment's name and returns the folder of its parts' files, or None.
    """
    results: dict[str, Results] = {}
    for name, facts in read_facts(folder / "run.csv").items():
        try:
            settings = _checked_settings(name, facts)
            rows = read_table(folder / f"{name}.csv")
        except (OSError, ValueError, KeyError, RecursionError) as error:
            warn(f"{name} is left out: {error}; run it again")
            continue
        results[name] = Results(settings, rows, files(name), results)
    return results


def _checked_settings(name: str, facts: Facts) -> dict[str, Any]:
    """Return the settings of an experiment's run.

    Raises
    ------
    KeyError, ValueError, RecursionError
        If a fact is missing or damaged, or the name could be a path.
    """
    settings = json.loads(facts["settings"])
    if (
        re.fullmatch(r"[\w-]+", name) is None
        or not isinstance(settings, dict)
        or not isinstance(settings.get("quick"), bool)
        or not isinstance(settings.get("BM3D"), str)
        or not 0 <= float(facts["seconds"]) < math.inf
        or "machine" not in facts
    ):
        raise ValueError("its facts in run.csv are damaged")
    dt.date.fromisoformat(facts["date"])
    return settings
