"""From results to what people look at: a page, a page of Markdown, and figures."""

import io
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

from jotlight import plots
from jotlight.errors import warn
from jotlight.experiments import EXPERIMENTS, running
from jotlight.experiments.experiment import Results
from jotlight.experiments.fig7 import decoded
from jotlight.experiments.report import overview
from jotlight.experiments.report.markdown import markdown
from jotlight.experiments.report.page import page
from jotlight.experiments.report.section import Report, Scene, Section
from jotlight.experiments.running import Folder
from jotlight.files import atomic_write

TITLE = "The paper, reproduced"

WORDS = (
    "The paper “Learning optimal parameters for binary sensing image reconstruction algorithms” "
    "claims that a network of two linear filters and two splines, trained from the classical "
    "pipeline, gives pictures as good as the best denoisers in a fifth of their time. Below is "
    "every claim of its section 4 beside what was measured here, then each experiment. Every "
    "number comes from a table that the command written there made. The paper leaves open which σ "
    "in [0.25, 1] its initial filter has, and much depends on it: “in part” means that a claim "
    "holds from some of the starts shown, and no verdict rests on the one σ that suits it best."
)


def report_of(results: dict[str, Results], facts: dict[str, running.Facts]) -> Report:
    """Give the report of all experiments that have results."""
    found = [name for name in EXPERIMENTS if name in results]
    quick = [name for name in found if results[name].settings["quick"]]
    words = WORDS
    if quick:
        words += (
            f" These are quick runs ({', '.join(quick)}), to see that everything works: too few "
            "images and steps to conclude anything from."
        )
    machines = {facts[name]["machine"]: None for name in found}
    denoisers = {json.loads(facts[name]["settings"])["BM3D"]: None for name in found}
    seconds = sum(float(facts[name]["seconds"]) for name in found)
    dates = sorted({facts[name]["date"] for name in found})
    shown = [
        ("Machine", "; ".join(machines)),
        ("Date", " to ".join(dict.fromkeys((dates[0], dates[-1])))),
        (
            "Time of all parts",
            f"{seconds / 60:.0f} minutes" if seconds >= 120 else f"{seconds:.0f} seconds",
        ),
        ("BM3D", "; ".join(denoisers)),
    ]
    makers: dict[str, Callable[[], Section | None]] = {
        "overview": partial(overview.section, results),
        **{name: partial(EXPERIMENTS[name].section, results[name]) for name in found},
    }
    sections = []
    for name, section in makers.items():
        try:
            made = section()
        except (KeyError, IndexError, TypeError, ValueError) as error:
            warn(f"{name} is left out: its table is damaged ({error!r}); run it again")
            continue
        if made is not None:
            sections.append(made)
    return Report(TITLE, words, shown, sections)


def read_report(results: Path) -> Report:
    """Give the report from a folder of tables, without pictures."""
    return report_of(
        running.read_results(results, lambda _: None), running.read_facts(results / "run.csv")
    )


def write_report(folder: Folder) -> Report:
    """Write page, Markdown and figures from the tables in a folder."""
    results = running.read_results(folder.results, lambda name: folder.path / "parts" / name)
    report = report_of(results, running.read_facts(folder.results / "run.csv"))
    for section in report.sections:
        if section.scenes:
            # A wide scene makes a figure that fits a page.
            widest = max(section.scenes, key=lambda scene: scene.size[1] / scene.size[0])
            _write(folder.results / section.picture, figure_of(widest))
    write_markdown(report, folder.results)
    _write(folder.page, page(report).encode())
    return report


def write_markdown(report: Report, results: Path) -> None:
    """Write the page of Markdown and its curves beside the tables."""
    for section in report.sections:
        for curve in section.curves:
            _write(results / f"{curve.name}.svg", curve.svg.encode())
    _write(results / "reproduction.md", markdown(report).encode())


def figure_of(scene: Scene) -> bytes:
    """All pictures of a scene side by side, with the crop enlarged, as JPEG."""
    panels = []
    for picture in scene.pictures:
        levels = decoded(picture.file, f"{scene.title}, {picture.title}")
        step = levels.shape[0] // scene.size[0]
        panels.append(plots.Panel(picture.title, picture.subtitle, levels[::step, ::step], levels))
    file = io.BytesIO()
    plots.comparison(panels, scene.title).savefig(
        file, format="jpg", dpi=60, pil_kwargs={"quality": 80}
    )
    return file.getvalue()


def _write(path: Path, content: bytes) -> None:
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)
