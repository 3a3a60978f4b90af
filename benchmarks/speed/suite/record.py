"""The files of a run: raw JSON, figures, and the page that is made of the JSON alone."""

import json
from pathlib import Path
from typing import Any

from suite.curves import curves
from suite.page import page

FOLDER, NAME, PAGE = "speed", "run.json", "speed.md"


def write(found: dict[str, Any], folder: Path) -> Path:
    """Write all of them; gives the page's place."""
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    text = json.dumps(rounded(found), indent=1, ensure_ascii=False) + "\n"
    (folder / FOLDER / NAME).write_text(text, "utf-8")
    return write_page(read(folder), folder)


def write_page(found: dict[str, Any], folder: Path) -> Path:
    for name, svg in curves(found).items():
        (folder / FOLDER / f"{name}.svg").write_text(svg, "utf-8")
    (folder / PAGE).write_text(page(found), "utf-8")
    return folder / PAGE


def read(folder: Path) -> dict[str, Any]:
    return json.loads((folder / FOLDER / NAME).read_text("utf-8"))


def rounded(value: Any) -> Any:
    """Floats to six figures, which is more than a clock gives."""
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(inner) for inner in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value
