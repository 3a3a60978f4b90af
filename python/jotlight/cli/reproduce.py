"""`jotlight reproduce`: the paper's experiments, as tables, figures and one page."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from jotlight.cli import sensor_options
from jotlight.cli.console import err, out, progress

if TYPE_CHECKING:
    from jotlight.experiments.report.content import Section

_NAMES = ("fig5", "fig6a", "fig6b", "fig7", "timing", "gain")
_ALL = "all"
_STYLES = {
    "reproduced": "green",
    "better": "bold green",
    "not reproduced": "red",
    "in part": "yellow",
    "not tested": "dim",
}


def reproduce(
    name: Annotated[str, typer.Argument(help=f"{', '.join(_NAMES)}, or {_ALL}.")],
    *,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="A look within seconds: too little to conclude from."),
    ] = False,
    data: Annotated[
        Path | None,
        typer.Option(
            help="The folder that holds BSDS and CIFAR-10. Default: download them once.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The folder for page, tables and figures. Default: reproduction, or "
            "reproduction-quick.",
        ),
    ] = None,
    restart: Annotated[
        bool, typer.Option("--restart", help="Forget what earlier runs left in the folder.")
    ] = False,
    threads: sensor_options.Threads = None,
) -> None:
    """Run the paper's experiments, and show them beside its claims.

    Stopped by Ctrl-C, the same command goes on where it was.

    Results go to a folder: report.html to look at, and results/ with reproduction.md, a .csv of all
    numbers, and the figures.
    """
    # Not sooner: nothing else needs them.
    from jotlight.experiments import EXPERIMENTS, runner, tables
    from jotlight.experiments.experiment import Data
    from jotlight.experiments.report.report import write_report

    if name != _ALL and name not in EXPERIMENTS:
        raise ValueError(
            f"reproduce: expected one of {', '.join(EXPERIMENTS)}, or {_ALL}, got {name!r}"
        )
    chosen = list(EXPERIMENTS.values()) if name == _ALL else [EXPERIMENTS[name]]
    folder = runner.Folder(output or Path("reproduction-quick" if quick else "reproduction"))
    if folder.path.exists() and not folder.path.is_dir():
        raise NotADirectoryError(f"{folder.path}: expected a folder, and it is a file")
    material = Data(data)
    needs = list(dict.fromkeys(need for experiment in chosen for need in experiment.datasets))
    if needs:
        with progress(2 * len(needs)) as begin:
            material.load(needs, begin)
    folder.results.mkdir(parents=True, exist_ok=True)
    work = []
    for experiment in chosen:
        lab = runner.prepare(
            experiment, folder, quick=quick, restart=restart, data=material, threads=threads
        )
        parts = experiment.parts(lab)
        left = [part for part in parts if not folder.part_file(experiment, part).exists()]
        if len(left) < len(parts):
            err.print(
                f"{experiment.name}: {len(parts) - len(left)} of {len(parts)} parts are there"
            )
        work.append((experiment, lab, left))
    total = sum(part.seconds for _, _, left in work for part in left)
    facts: dict[str, tables.Facts] = {}
    try:
        with progress(total, remaining=True) as begin:
            for experiment, lab, left in work:
                for number, part in enumerate(left):
                    title = f"{experiment.name}, {part.name}"
                    seconds = runner.run_part(experiment, part, folder, begin(title, part.seconds))
                    if not err.is_terminal:
                        err.print(f"{title}: {seconds:.1f} s ({number + 1} of {len(left)})")
                rows, facts[experiment.name] = runner.collect(experiment, lab, folder)
                tables.write_table(folder.results / f"{experiment.name}.csv", rows)
    except KeyboardInterrupt:
        err.print(
            f"\nWhat is done is kept in [bold]{escape(str(folder.path))}[/]: the same command "
            "goes on"
        )
        raise
    tables.write_facts(folder.results / "run.csv", facts)
    report = write_report(folder)
    out.print(_claims([section for section in report.sections if section.name in facts]))
    if quick:
        out.print("[yellow]A quick run: too little to conclude from.[/]")
    out.print(f"Look at [bold]{escape(str(folder.page))}[/]", soft_wrap=True)


def _claims(sections: "list[Section]") -> Table:
    """The paper's claims, with what became of them."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("")
    table.add_column("the paper")
    table.add_column("verdict", no_wrap=True)
    for section in sections:
        for claim in section.claims:
            style = _STYLES[claim.verdict]
            table.add_row(section.name, escape(claim.statement), f"[{style}]{claim.verdict}[/]")
    return table
