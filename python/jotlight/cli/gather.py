"""``jotlight gather``: completion of the results of a job array."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jotlight.cli.terminal.console import progress, report
from jotlight.errors import counted
from jotlight.formats.opening.locations import expand
from jotlight.output_links import follow_link


def gather(
    *folders: Annotated[
        Path,
        Parameter(
            help="Folders that contain the results, or unfinished ones, NAME.zarr.part, or globs "
            "of them in quotation marks."
        ),
    ],
) -> None:
    """Complete the results of a job array, whose tasks ran with --part.

    Results that are missing, or have missing parts, are listed. The content of the other ones is
    not compared with their records.
    """
    from jotlight.runs.gathering import find_unfinished, gather_results
    from jotlight.runs.shared_runs import check_results, find_runs
    from jotlight.runs.store import PART

    if not folders:
        raise ValueError("gather: expected one folder or more")
    paths = [Path(each) for folder in folders for each in expand(str(folder))]
    parts, runs = find_unfinished(paths), find_runs(paths)
    if not parts and not runs:
        report("nothing to complete: these folders contain no unfinished results, NAME.zarr.part")
        return
    unfinished: dict[Path, str] = {}
    if parts:
        with progress(1) as begin:
            finished, unfinished = gather_results(parts, begin("gathering"))
        report(f"{len(finished)} of {counted(len(parts), 'result')} completed")
    number, missing = check_results(runs)
    begun = {path.with_name(path.name.removesuffix(PART)) for path in unfinished}
    never = [path for path in missing if follow_link(path) not in begun]
    reasons = {**unfinished, **dict.fromkeys(never, "no part has made it, or its part failed")}
    if runs:
        have = "has a result" if number == 1 else "have results"
        report(f"{number - len(missing)} of {counted(number, 'capture')} {have}")
    if reasons:
        text = "; ".join(f"{path}: {reason}" for path, reason in list(reasons.items())[:20])
        more = f"; and {len(reasons) - 20} more" if len(reasons) > 20 else ""
        states = ", ".join(str(folder) for folder in runs if folder.exists())
        vanished = f"; if a capture no longer exists, first delete {states}" if never else ""
        raise ValueError(
            f"{counted(len(reasons), 'result')} not complete: {text}{more}; run the parts again"
            f"{vanished}"
        )
