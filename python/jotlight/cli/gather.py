"""``jotlight gather``: completion of the results of a job array."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jotlight.cli.terminal.console import progress, report
from jotlight.errors import counted
from jotlight.formats.opening.locations import expand


def gather(
    *folders: Annotated[
        Path,
        Parameter(
            help="Folders that contain unfinished results, NAME.zarr.part, or globs of them in "
            "quotation marks."
        ),
    ],
) -> None:
    """Complete the results of a job array, whose tasks ran with --part.

    Results with missing parts stay unfinished, and are listed.
    """
    from jotlight.dask.gathering import find_unfinished, gather_results

    if not folders:
        raise ValueError("gather: expected one folder or more")
    parts = find_unfinished(Path(each) for folder in folders for each in expand(str(folder)))
    if not parts:
        report("nothing to complete: these folders contain no unfinished results, NAME.zarr.part")
        return
    with progress(1) as begin:
        finished, unfinished = gather_results(parts, begin("gathering"))
    report(f"{len(finished)} of {counted(len(parts), 'result')} completed")
    if unfinished:
        text = "; ".join(f"{path}: {reason}" for path, reason in list(unfinished.items())[:20])
        raise ValueError(f"{counted(len(unfinished), 'result')} not complete: {text}")
