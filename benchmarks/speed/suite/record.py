"""The files of a run: the JSON with every time, the page, and its curves."""

import json
from pathlib import Path
from typing import Any

from jotlight.experiments.report.markdown import render_markdown
from suite.page import DATA_FILE, build_report

PAGE_FILE = "speed.md"


def write(run: dict[str, Any], folder: Path) -> Path:
    """Write JSON, page, and curves into a folder, and return the page's path."""
    path = folder / DATA_FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(rounded(run), indent=1, ensure_ascii=False) + "\n", "utf-8")
    return write_page(read(folder), folder)


def write_page(run: dict[str, Any], folder: Path) -> Path:
    """Write page and curves into a folder, and return the page's path."""
    report = build_report(run)
    for section in report.sections:
        for curves in section.curves:
            (folder / f"{curves.name}.svg").write_text(curves.svg, "utf-8")
    (folder / PAGE_FILE).write_text(render_markdown(report), "utf-8")
    return folder / PAGE_FILE


def read(folder: Path) -> dict[str, Any]:
    """Return the run whose JSON a folder holds."""
    return json.loads((folder / DATA_FILE).read_text("utf-8"))


def rounded(value: Any) -> Any:
    """Return a value with six digits of each float, which is finer than a clock measures."""
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(inner) for inner in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value
