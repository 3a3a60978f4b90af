"""Runs of `reconstruct` and `convert` over many captures, or over the windows of a capture."""

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.run_options import RunOptions
from jotlight.cli.runs.capture_jobs import Target, check_video_name
from jotlight.cli.runs.run_notes import caution_about_moving_scenes, report_notes
from jotlight.cli.terminal.console import caution, progress, report
from jotlight.disk_space import format_bytes
from jotlight.errors import counted, error_message
from jotlight.files import check_outputs
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.opening.locations import is_url
from jotlight.runs.capture_source import CaptureSource
from jotlight.runs.cluster import connected
from jotlight.runs.jobs import Job
from jotlight.runs.names import Part, find_captures, name_captures, name_outputs
from jotlight.runs.records import AnotherRunError
from jotlight.runs.running import (
    Cluster,
    Executor,
    Outcome,
    ThisProcess,
    run_jobs,
)
from jotlight.runs.shared_runs import SharedRun
from jotlight.sensing.bits.bits import Bits

_MAX_SHOWN = 20
"""Number of failed captures whose errors are repeated at the end."""

MakeJob = Callable[[Target, Bits, CaptureSource], tuple[Job, list[str]]]
"""A function that returns the job of a capture, and what it assumes, one line each."""


def process(
    captures: tuple[str, ...],
    output: Path,
    capture: CaptureOptions,
    run: RunOptions,
    threads: int | None,
    check_name: Callable[[Path], object],
    make_job: MakeJob,
) -> None:
    """Make the results of all captures, and report them.

    `check_name` raises ValueError for a name, or a pattern of names, that no result without windows
    can have.

    Raises
    ------
    ValueError
        At the end, when some captures could not be processed.
    """
    if run.step is not None and run.window is None:
        raise ValueError(f"step: is for the windows of a capture; add --window {run.step}")
    if run.scheduler is not None and run.workers is not None:
        raise ValueError("expected one of --scheduler and --workers, got both")
    has_cluster = run.scheduler is not None or run.workers is not None
    if has_cluster and run.part is not None:
        raise ValueError("part: is for job arrays without dask; leave out --scheduler, --workers")
    part = None if has_cluster else Part.requested(run.part)
    paths = find_captures(captures, run.storage_options())
    names = name_captures(paths, captures)
    outputs = name_outputs(output, names)
    (check_name if run.window is None else check_video_name)(output)
    check_outputs(outputs, [Path(path) for path in paths if not is_url(path)])
    if has_cluster:  # whose workers may run in other folders
        outputs = [path.absolute() for path in outputs]
    shared = names
    if part is not None and part.total > 1:
        shared = _shared_captures(output, captures, names)
    numbers = {name: number for number, name in enumerate(shared)}
    chosen = [
        Target(path, name, file, numbers[name])
        for path, name, file in zip(paths, names, outputs, strict=True)
        if name in numbers and (part is None or part.has_capture(numbers[name], len(shared)))
    ]
    made, refused = _make_jobs(chosen, capture, run, make_job)
    jobs = [job for _, job, _ in made]
    with _executor(run, threads, part) as executor, progress(1) as begin:
        report_notes([notes for *_, notes in made])
        outcome = run_jobs(
            jobs,
            executor,
            part=part,
            numbers=[target.number for target, *_ in made],
            captures=len(shared),
            progress=begin(counted(len(chosen), "capture") if len(names) > 1 else names[0]),
            # A single error is reported at the end.
            warn=lambda text: caution("failed", text) if len(chosen) > 1 else None,
        )
    new = {*outcome.made, *outcome.partial}
    caution_about_moving_scenes([job for job in jobs if job.name in new], threads)
    outcome.failed = {**refused, **outcome.failed}
    _report(outcome, {target.name: target for target in chosen}, part)


def _shared_captures(output: Path, captures: tuple[str, ...], names: list[str]) -> list[str]:
    """Return the names of the captures that all parts of the run divide."""
    run, folder = SharedRun.of(output, names).join(captures)
    if new := sorted(set(names) - set(run.captures)):
        examples = ", ".join(new[:3]) + (", …" if len(new) > 3 else "")
        caution(
            "captures",
            f"{counted(len(new), 'capture')} appeared after the first part of this run began, and "
            f"{'is' if len(new) == 1 else 'are'} left out: {examples}; when all parts have ended, "
            f"run `jotlight gather {run.folder}` and the parts again. To begin anew, delete "
            f"{folder}",
        )
    return run.captures


@contextlib.contextmanager
def _executor(run: RunOptions, threads: int | None, part: Part | None) -> Iterator[Executor]:
    if run.scheduler is None and run.workers is None:
        yield ThisProcess(mapped=part is not None, threads=threads)
        return
    with connected(run.scheduler, run.workers) as client:
        report(f"dashboard of dask: {client.dashboard_link}")
        yield Cluster(client)


def _make_jobs(
    targets: list[Target], capture: CaptureOptions, run: RunOptions, make_job: MakeJob
) -> tuple[list[tuple[Target, Job, list[str]]], dict[str, str]]:
    """Return the jobs of all captures that can be processed, and the errors of the others.

    With each job, return what it assumes, one line each.

    Raises
    ------
    OSError, ValueError
        When there is no job. If all captures that can be opened are unfit for the same reason, it
        is the error, after warnings of the damaged ones.
    """
    options = _opening(capture, run)
    jobs: list[tuple[Target, Job, list[str]]] = []
    damaged: dict[str, Exception] = {}
    unfit: dict[str, Exception] = {}
    with progress(max(1, len(targets))) as begin:
        for target in targets:
            begin(f"opening {target.name}")
            try:
                source = _source(target.path, options)
                bits = source.open()
            except (OSError, ValueError) as error:
                if is_url(target.path) and isinstance(error, PermissionError):
                    raise  # credentials that fail concern all captures
                damaged[target.name] = error
                continue
            try:
                jobs.append((target, *make_job(target, bits, source)))
            except AnotherRunError:
                raise
            except (OSError, ValueError) as error:
                unfit[target.name] = error
    reasons = {error_message(error): error for error in (unfit or damaged).values()}
    if not jobs and len(reasons) == 1:
        for name, damage in damaged.items() if unfit else ():
            caution("failed", f"{name}: {error_message(damage)}")
        raise next(iter(reasons.values()))
    refused = {name: error_message(error) for name, error in {**damaged, **unfit}.items()}
    if not jobs and refused:
        raise _failure(refused, len(targets))
    for name, text in refused.items():
        caution("failed", f"{name}: {text}")
    return jobs, refused


def _opening(capture: CaptureOptions, run: RunOptions) -> ReadingOptions:
    """Return the options with which the workers open the captures."""
    if capture.counts_scale is not None or capture.trials is not None:
        raise ValueError("counts-scale, trials: are for one capture of counts, not for a run")
    return dataclasses.replace(capture.to_options(), storage_options=run.storage_options())


def _source(path: str, options: ReadingOptions) -> CaptureSource:
    """Return a capture as the workers open it."""
    if is_url(path):
        return CaptureSource.of(path, options)
    kept = dataclasses.replace(options, storage_options=None)
    return CaptureSource.of(str(Path(path).absolute()), kept)


def _report(outcome: Outcome, targets: dict[str, Target], part: Part | None) -> None:
    made = len(outcome.made) + len(outcome.partial)
    share = "" if part is None else f" (part {part.number} of {part.total})"
    lines = [f"{made} made{share}"]
    if outcome.existed:
        lines.append(f"{len(outcome.existed)} complete before")
    if outcome.elsewhere:
        lines.append(f"{len(outcome.elsewhere)} completed meanwhile by another process")
    if outcome.failed:
        lines.append(f"{len(outcome.failed)} failed")
    if len(targets) == 1 and outcome.made:
        result = targets[outcome.made[0]].output
        size = sum(file.stat().st_size for file in [result, *result.rglob("*")] if file.is_file())
        report(f"{result}: {format_bytes(size)}")
    report(f"{counted(len(targets), 'capture')}: {', '.join(lines)}")
    if outcome.partial:
        report("when all parts have ended, `jotlight gather` completes the results")
    if outcome.failed:
        raise _failure(outcome.failed, len(targets))


def _failure(failed: dict[str, str], number: int) -> ValueError:
    """Return the error of a run in which some of a number of captures failed."""
    shown = list(failed.items())[:_MAX_SHOWN]
    more = len(failed) - len(shown)
    text = "; ".join(f"{name}: {error}" for name, error in shown)
    share = "" if number == 1 else f"{len(failed)} of {number} captures failed: "
    return ValueError(share + text + (f"; and {more} more" if more else ""))
