"""Runs over many captures: units on a cluster or in this process, resumption, and failures."""

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

from jotlight._engine import __version__
from jotlight.checks import check_threads
from jotlight.disk_space import check_disk_space
from jotlight.errors import error_message, record_warnings, warn
from jotlight.runs.cluster import check_version
from jotlight.runs.jobs import Job
from jotlight.runs.names import Part
from jotlight.runs.records import AnotherRunError
from jotlight.runs.reporting import naming_worker

_AHEAD = 4
"""Number of units per thread of the cluster that are submitted ahead of time."""

_RESERVE = 1 << 26
"""Number of bytes of a disk that a run leaves free."""


@dataclasses.dataclass
class Outcome:
    """What became of the captures of a run, by their names."""

    made: list[str] = dataclasses.field(default_factory=list)
    existed: list[str] = dataclasses.field(default_factory=list)
    """Captures whose results were complete before."""
    elsewhere: list[str] = dataclasses.field(default_factory=list)
    """Captures whose results another process with the same run has completed meanwhile."""
    partial: list[str] = dataclasses.field(default_factory=list)
    """Captures of which this part of the run has made its share."""
    failed: dict[str, str] = dataclasses.field(default_factory=dict)
    """The error of each capture that could not be processed."""


class Executor(Protocol):
    """Something that computes units."""

    def run(
        self, units: Generator[tuple[int, Job, int]]
    ) -> Iterator[tuple[int, int, BaseException | None]]:
        """Yield the number of the job, the unit, and its error, in any order."""


@dataclasses.dataclass(frozen=True)
class ThisProcess:
    """An executor that computes one unit after the other, with all threads of the engine."""

    mapped: bool = False
    threads: int | None = None

    def __post_init__(self) -> None:
        check_threads(self.threads)

    def run(
        self, units: Generator[tuple[int, Job, int]]
    ) -> Iterator[tuple[int, int, BaseException | None]]:
        """Yield the number of the job, the unit, and its error."""
        for number, job, unit in units:
            try:
                job.compute(unit, self.threads, self.mapped)
            except Exception as error:
                yield number, unit, error
            else:
                yield number, unit, None


@dataclasses.dataclass(frozen=True)
class Cluster:
    """An executor that submits units to a ``dask.distributed.Client``."""

    client: Any

    def run(
        self, units: Generator[tuple[int, Job, int]]
    ) -> Iterator[tuple[int, int, BaseException | None]]:
        """Yield the number of the job, the unit, and its error, in the order of completion."""
        from distributed import as_completed

        limit = max(16, _AHEAD * sum(self.client.nthreads().values()))
        running: dict[Any, tuple[int, int]] = {}
        # The scheduler stores a job once, and not once for each of its units. If the worker that
        # holds it dies, it makes the job again.
        jobs: dict[int, Any] = {}
        completed = as_completed()
        with contextlib.closing(units):
            # One message for many units takes the scheduler less time than one for each.
            while group := list(itertools.islice(units, limit // 2)):
                new = {number: job for number, job, _ in group if number not in jobs}
                added = self.client.map(_return, list(new.values()), pure=False)
                needed = {number for number, *_ in group}
                jobs = {number: job for number, job in jobs.items() if number in needed}
                jobs |= zip(new, added, strict=True)
                futures = self.client.map(
                    compute_unit,
                    [jobs[number] for number, *_ in group],
                    [unit for *_, unit in group],
                    version=__version__,
                    pure=False,
                )
                for future, (number, _, unit) in zip(futures, group, strict=True):
                    running[future] = number, unit
                completed.update(futures)
                while len(running) > limit // 2:
                    yield from self._take(completed, running)
            while running:
                yield from self._take(completed, running)

    def _take(
        self, completed: Any, running: dict[Any, tuple[int, int]]
    ) -> Iterator[tuple[int, int, BaseException | None]]:
        """Yield all units that are complete, after waiting for one, and issue their warnings."""
        batch = completed.next_batch()
        for messages in self.client.gather(batch, errors="skip"):
            for message in messages:
                warn(message)
        for future in batch:
            number, unit = running.pop(future)
            error = future.exception() if future.status != "finished" else None
            future.release()
            yield number, unit, error


def _return(job: Job) -> Job:
    return job


def compute_unit(job: Job, unit: int, version: str) -> list[str]:
    """Compute a unit in a worker, and return the messages of its warnings.

    Raises
    ------
    RuntimeError
        When the worker has another version of jotlight.
    """
    check_version(version)
    with record_warnings() as messages, naming_worker():
        job.compute(unit, 1, True)
    return list(dict.fromkeys(messages))


def check_outputs(jobs: Sequence[Job]) -> list[Job]:
    """Return the jobs whose results are not complete.

    Raises
    ------
    AnotherRunError
        When an output is that of another run, or two jobs have the same output.
    OSError
        When the results do not fit on the disk.
    """
    outputs: dict[Path, str] = {}
    for job in jobs:
        other = outputs.setdefault(job.output.absolute(), job.name)
        if other != job.name:
            raise AnotherRunError(f"{job.output}: is the output of both {other} and {job.name}")
    missing = [job for job in jobs if not job.is_complete()]
    check_disk_space(
        [(job.output, job.nbytes) for job in missing],
        reserve=_RESERVE,
        advice="free some space, choose another folder, or use larger windows",
    )
    return missing


def run_jobs(
    jobs: Sequence[Job],
    executor: Executor,
    *,
    part: Part | None = None,
    numbers: Sequence[int] | None = None,
    captures: int | None = None,
    progress: Callable[[float], object] = lambda fraction: None,
    warn: Callable[[str], object] = lambda text: None,
) -> Outcome:
    """Compute all units of jobs that are not complete, and return what became of the captures.

    An error of one capture does not stop the others.

    Parameters
    ----------
    jobs : sequence of Job
    executor : Executor
    part : Part, optional
        The part of the units to compute. Default: all.
    numbers : sequence of int, optional
        The number of the capture of each job among all captures. Default: 0, 1, and so on.
    captures : int, optional
        Number of all captures of the run. Default: that of the jobs.
    progress : callable, optional
        A function that is called repeatedly with the completed fraction, from 0 to 1.
    warn : callable, optional
        A function that takes the error of a capture when it occurs.

    Raises
    ------
    AnotherRunError, OSError
        Before any work, as :func:`check_outputs`.
    """
    run = _Run(jobs, part, warn)
    run.prepare(numbers or range(len(jobs)), len(jobs) if captures is None else captures)
    total = sum(len(units) for units in run.todo.values())
    for done, (index, _, failure) in enumerate(executor.run(run.units()), 1):
        run.complete(index, failure)
        progress(done / total)
    return run.outcome


class _Run:
    """The state of a run: the units to compute, and what became of the captures."""

    def __init__(
        self, jobs: Sequence[Job], part: Part | None, warn: Callable[[str], object]
    ) -> None:
        self.outcome = Outcome()
        self.todo: dict[int, list[int]] = {}
        """The units of each job, by its index."""
        self._jobs, self._part, self._warn = jobs, part, warn
        self._left: dict[int, int] = {}
        self._finishes = True

    def prepare(self, numbers: Sequence[int], captures: int) -> None:
        """Check the outputs, and find the units to compute."""
        part = self._part
        # If several parts compute units of a job, no part can complete it.
        self._finishes = part is None or part.divides_captures(captures)
        missing = {id(job) for job in check_outputs(self._jobs)}
        for index, (job, number) in enumerate(zip(self._jobs, numbers, strict=True)):
            if id(job) not in missing:
                self.outcome.existed.append(job.name)
                continue
            try:
                units = job.prepare()
            except (OSError, ValueError) as error:
                self._fail(job, error)
                continue
            own = [unit for unit in units if part is None or part.has(number, unit, captures)]
            self.todo[index], self._left[index] = own, len(own)
            if not units:
                self._finish(job)

    def units(self) -> Generator[tuple[int, Job, int]]:
        """Yield the index of the job, the job, and the unit. Jobs that ended have no more units."""
        for index, own in self.todo.items():
            job = self._jobs[index]
            for unit in own:
                if not self._has_ended(job):
                    yield index, job, unit

    def complete(self, index: int, failure: BaseException | None) -> None:
        """Note that a unit was computed, or failed."""
        job = self._jobs[index]
        self._left[index] -= 1
        if failure is not None:
            self._fail(job, failure)
        if self._left[index] == 0:
            self._finish(job)

    def _has_ended(self, job: Job) -> bool:
        """Return whether a job has failed, or another process has completed it."""
        return job.name in self.outcome.failed or job.name in self.outcome.elsewhere

    def _finish(self, job: Job) -> None:
        if self._has_ended(job):
            return
        if not self._finishes and not job.is_single:
            self.outcome.partial.append(job.name)
            return
        try:
            job.finish()
        except (OSError, ValueError) as error:
            self._fail(job, error)
        else:
            self.outcome.made.append(job.name)

    def _fail(self, job: Job, error: BaseException) -> None:
        if self._has_ended(job):
            return
        if _is_made_elsewhere(job, error):
            self.outcome.elsewhere.append(job.name)
            return
        known = isinstance(error, ValueError | OSError | RuntimeError)
        text = error_message(error) if known else f"{type(error).__name__}: {error}".splitlines()[0]
        self.outcome.failed[job.name] = text
        self._warn(f"{job.name}: {text}")


def _is_made_elsewhere(job: Job, error: BaseException) -> bool:
    """Return whether a job failed because another process with the same run has completed it.

    That process moves the files of a video, so this one finds them missing. Folders that exist are
    not replaced. Single files may be, by the same bytes. Errors of the disk, such as a failed flush
    after a file has its name, are not excused.
    """
    if not isinstance(error, FileNotFoundError | FileExistsError | ValueError):
        return False
    try:
        return job.is_complete()
    except (OSError, ValueError):
        return False
