"""``jotlight reproduce``: the paper's experiments, as tables, figures and one page."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.markup import escape
from rich.table import Table

from jotlight.cli.options.common_options import OWN, Threads
from jotlight.cli.options.method_options import split_names
from jotlight.cli.terminal.console import err, out, progress, report
from jotlight.evaluation.own_method import import_method
from jotlight.parameter_names import check_choice

if TYPE_CHECKING:
    from jotlight.experiments import runner, tables
    from jotlight.experiments.experiment import Experiment, Part, RunContext
    from jotlight.experiments.report.content import Section

EXPERIMENT_NAMES = ("fig5", "fig6a", "fig6b", "fig7", "timing", "gain")
_ALL = "all"
_STYLES = {
    "reproduced": "green",
    "better": "bold green",
    "not reproduced": "red",
    "in part": "yellow",
    "not tested": "dim",
}


def reproduce(
    name: Annotated[str, Parameter(help=f"{', '.join(EXPERIMENT_NAMES)}, or {_ALL}.")],
    /,
    *,
    method: Annotated[
        list[str] | None,
        Parameter(
            alias="-m",
            help=f"{OWN}, in addition to jotlight's methods in fig7, timing, and gain. Separate "
            "several by commas, or repeat the option. With them, a finished run starts anew. An "
            "interrupted run checks their modules, but no other files that they read. Default: "
            "none.",
        ),
    ] = None,
    quick: Annotated[
        bool,
        Parameter(help="A short run, about a minute for all: too short to draw conclusions from."),
    ] = False,
    data: Annotated[
        Path | None,
        Parameter(help="The folder that holds BSDS and CIFAR-10. Default: download them once."),
    ] = None,
    output: Annotated[
        Path | None,
        Parameter(
            alias="-o",
            help="The folder for page, tables, and figures. Default: reproduction, or "
            "reproduction-quick.",
        ),
    ] = None,
    restart: Annotated[
        bool, Parameter(help="Discard the results of earlier runs in the folder.")
    ] = False,
    threads: Threads = None,
) -> None:
    """Run the paper's experiments, and compare them with its claims.

    After Ctrl-C the same command resumes the run.

    The folder receives report.html for display, and results/ with reproduction.md, a .csv of all
    numbers, and the figures.
    """
    # Other commands start faster without these modules.
    from jotlight.experiments import EXPERIMENTS, runner, tables
    from jotlight.experiments.experiment import Data
    from jotlight.experiments.report.report import write_report

    if name != _ALL:
        check_choice("reproduce", name, EXPERIMENTS, f", or {_ALL}")
    experiments = list(EXPERIMENTS.values()) if name == _ALL else [EXPERIMENTS[name]]
    own = _own_methods(method, experiments)
    folder = runner.Folder(output or Path("reproduction-quick" if quick else "reproduction"))
    if folder.path.exists() and not folder.path.is_dir():
        raise NotADirectoryError(f"{folder.path}: expected a folder, and it is a file")
    material = Data(data)
    needs = list(dict.fromkeys(need for experiment in experiments for need in experiment.datasets))
    if needs:
        with progress(2 * len(needs)) as begin:
            material.load(needs, begin)
    folder.results.mkdir(parents=True, exist_ok=True)
    prepare = partial(
        runner.prepare, quick=quick, restart=restart, data=material, threads=threads, own=own
    )
    work = []
    for experiment in experiments:
        context = prepare(experiment, folder)
        work.append((experiment, context, _parts_left(experiment, context, folder)))
    facts = _run(work, folder)
    tables.write_facts(folder.results / "run.csv", facts)
    written = write_report(folder)
    for _, context, _ in work:
        runner.finish(context)
    sections = [section for section in written.sections if section.name in facts]
    out.print(_claims(sections), markup=True)
    if quick:
        out.print("[yellow]A quick run: too little to draw conclusions from.[/]", markup=True)
    report(f"Report: {folder.page}")


def _own_methods(values: list[str] | None, experiments: "list[Experiment]") -> list[str]:
    """Return the names of functions of the caller, after their import."""
    own = list(dict.fromkeys(split_names(values)))
    if own and not any(experiment.compares_methods for experiment in experiments):
        raise ValueError(
            f"method: {experiments[0].name} compares no methods; fig7, timing, and gain do"
        )
    for name in own:
        import_method(name)
    return own


def _parts_left(
    experiment: "Experiment", context: "RunContext", folder: "runner.Folder"
) -> "list[Part]":
    """Return the parts of an experiment that earlier runs have not finished."""
    parts = experiment.parts(context)
    left = [part for part in parts if not folder.part_file(experiment, part).exists()]
    if len(left) < len(parts):
        done = f"{experiment.name}: {len(parts) - len(left)} of {len(parts)} parts are done"
        if context.own:
            done += (
                f"; if a file that {' or '.join(context.own)} reads has changed since then, add "
                "--restart"
            )
        err.print(done)
    return left


def _run(
    work: "list[tuple[Experiment, RunContext, list[Part]]]", folder: "runner.Folder"
) -> "dict[str, tables.Facts]":
    """Run the remaining parts of experiments and return the facts about each experiment."""
    from jotlight.experiments import runner, tables

    total = sum(part.seconds for _, _, left in work for part in left)
    facts: dict[str, tables.Facts] = {}
    try:
        with progress(total, remaining=True) as begin:
            for experiment, context, left in work:
                for number, part in enumerate(left):
                    title = f"{experiment.name}, {part.name}"
                    seconds = runner.run_part(experiment, part, folder, begin(title, part.seconds))
                    if not err.is_terminal:
                        err.print(f"{title}: {seconds:.1f} s ({number + 1} of {len(left)})")
                rows, facts[experiment.name] = runner.collect(experiment, context, folder)
                tables.write_table(folder.results / f"{experiment.name}.csv", rows)
    except KeyboardInterrupt:
        err.print(
            f"\nFinished parts are kept in [bold]{escape(str(folder.path))}[/]. The same command "
            "resumes the run."
        )
        raise
    return facts


def _claims(sections: "list[Section]") -> Table:
    """Return a table of the paper's claims with their verdicts."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("")
    table.add_column("the paper")
    table.add_column("verdict", no_wrap=True)
    for section in sections:
        for claim in section.claims:
            style = _STYLES[claim.verdict]
            table.add_row(section.name, escape(claim.statement), f"[{style}]{claim.verdict}[/]")
    return table
