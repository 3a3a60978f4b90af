"""The report of the experiments: an HTML page, a page of Markdown, and figures."""

import io
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

from jotlight.errors import warn
from jotlight.experiments import EXPERIMENTS
from jotlight.experiments.experiment import Results
from jotlight.experiments.png import decode_png
from jotlight.experiments.report.changes import changes_since
from jotlight.experiments.report.content import Report, Scene, Section
from jotlight.experiments.report.markdown import render_markdown
from jotlight.experiments.report.overview import overview_section
from jotlight.experiments.report.page import render_page
from jotlight.experiments.runner import Folder
from jotlight.experiments.tables import Facts, read_facts, read_results
from jotlight.files import write_file
from jotlight.plots import Panel, comparison

TITLE = "The paper, reproduced"

INTRODUCTION = (
    "This page compares every claim of section 4 of the paper “Learning optimal parameters for "
    "binary sensing image reconstruction algorithms” with measurements of jotlight. The paper "
    "claims that a network of two linear filters and two splines, trained from the classical "
    "pipeline, is as good as the best denoisers in a fifth of their time. The first table lists "
    "the claims, and each section below has the command that repeats it. σ is the standard "
    "deviation of the Gaussian h2 with which this network starts. The paper says only that it is "
    "in [0.25, 1], and the results depend on it. “In part” means that a claim holds for some of "
    "the σ shown here. No verdict rests on the one σ that suits the claim best."
)


def build_report(results: dict[str, Results], facts: dict[str, Facts]) -> Report:
    """Return the report of all experiments that have results.

    Raises
    ------
    ValueError
        If none has any.
    """
    names = [name for name in EXPERIMENTS if name in results]
    if not names:
        raise ValueError("expected the results of an experiment, got none; run it again")
    quick = [name for name in names if results[name].settings["quick"]]
    text = INTRODUCTION
    if quick:
        text += (
            f" These are quick runs ({', '.join(quick)}) with few images and steps. They show "
            "that everything works; no conclusion follows from them."
        )
    first = min(facts[name]["date"] for name in names)
    if changes := changes_since(first):
        text += f" {changes}"
    makers: dict[str, Callable[[], Section | None]] = {
        "overview": partial(overview_section, results, first),
        **{name: partial(EXPERIMENTS[name].section, results[name]) for name in names},
    }
    sections = []
    for name, make in makers.items():
        try:
            section = make()
        except (KeyError, IndexError, TypeError, ValueError) as error:
            warn(f"{name} is left out: its table is damaged ({error!r}); run it again")
            continue
        if section is not None:
            sections.append(section)
    return Report(TITLE, text, _run_facts([facts[name] for name in names]), sections)


def _run_facts(facts: list[Facts]) -> list[tuple[str, str]]:
    """Return machine, date, duration, and BM3D's version over all experiments."""
    machines = dict.fromkeys(each["machine"] for each in facts)
    denoisers = dict.fromkeys(json.loads(each["settings"])["BM3D"] for each in facts)
    seconds = sum(float(each["seconds"]) for each in facts)
    dates = sorted({each["date"] for each in facts})
    duration = f"{seconds / 60:.0f} minutes" if seconds >= 120 else f"{seconds:.0f} seconds"
    return [
        ("Machine", "; ".join(machines)),
        ("Date", " to ".join(dict.fromkeys((dates[0], dates[-1])))),
        ("Time of all parts", duration),
        ("BM3D", "; ".join(denoisers)),
    ]


def read_report(results: Path) -> Report:
    """Return the report of a folder of tables, without images."""
    return build_report(read_results(results, lambda _: None), read_facts(results / "run.csv"))


def write_report(folder: Folder) -> Report:
    """Write the pages and figures of a folder's tables and return the report."""
    results = read_results(folder.results, folder.parts)
    report = build_report(results, read_facts(folder.results / "run.csv"))
    for section in report.sections:
        if section.scenes:
            # A wide scene makes a figure that fits a page.
            widest = max(section.scenes, key=lambda scene: scene.size[1] / scene.size[0])
            write_file(folder.results / section.image_file, comparison_jpeg(widest))
    write_markdown(report, folder.results)
    write_file(folder.page, render_page(report))
    return report


def write_markdown(report: Report, results: Path) -> None:
    """Write the page of Markdown and its curves into the folder of the tables."""
    for section in report.sections:
        for curve in section.curves:
            write_file(results / f"{curve.name}.svg", curve.svg)
    write_file(results / "reproduction.md", render_markdown(report))


def comparison_jpeg(scene: Scene) -> bytes:
    """Return all images of a scene side by side, with the crop enlarged, as JPEG."""
    panels = []
    for image in scene.images:
        levels = decode_png(image.file, f"{scene.title}, {image.title}")
        step = levels.shape[0] // scene.size[0]
        panels.append(Panel(image.title, image.subtitle, levels[::step, ::step], levels))
    file = io.BytesIO()
    comparison(panels, scene.title).savefig(file, format="jpg", dpi=60, pil_kwargs={"quality": 80})
    return file.getvalue()
