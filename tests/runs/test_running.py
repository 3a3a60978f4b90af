import dataclasses
import errno
import sys
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest

from jotlight._engine import __version__
from jotlight.errors import MissingExtraError, warn
from jotlight.formats.reading import open_capture
from jotlight.runs.cluster import connected
from jotlight.runs.names import Part
from jotlight.runs.records import AnotherRunError
from jotlight.runs.running import ThisProcess, compute_unit, run_jobs


@dataclasses.dataclass
class FakeJob:
    """A job that notes what is called, and may fail."""

    name: str
    output: Path
    units: int = 3
    nbytes: int = 0
    broken: int | None = None
    complete: bool = False
    foreign: bool = False
    is_single: bool = False
    computed: list = dataclasses.field(default_factory=list)
    finished: int = 0

    def is_complete(self):
        if self.foreign:
            raise AnotherRunError(f"{self.output}: belongs to another run")
        return self.complete

    def prepare(self):
        return [unit for unit in range(self.units) if unit not in self.computed]

    def compute(self, unit, threads, mapped):
        if unit == self.broken:
            raise ValueError("is damaged")
        self.computed.append(unit)
        self.complete = self.is_single

    def finish(self):
        self.finished += 1


def jobs_in(folder, number=3, **options):
    return [FakeJob(f"job{i}", folder / f"{i}.zarr", **options) for i in range(number)]


def test_all_units_are_computed_once_and_each_job_is_finished_once(tmp_path):
    jobs, fractions = jobs_in(tmp_path), []
    outcome = run_jobs(jobs, ThisProcess(), progress=fractions.append)
    assert outcome.made == ["job0", "job1", "job2"]
    assert [job.computed for job in jobs] == [[0, 1, 2]] * 3
    assert [job.finished for job in jobs] == [1] * 3
    np.testing.assert_allclose(fractions, np.arange(1, 10) / 9)


def test_a_damaged_capture_does_not_stop_the_others(tmp_path):
    jobs, shown = jobs_in(tmp_path), []
    jobs[1].broken = 1
    outcome = run_jobs(jobs, ThisProcess(), warn=shown.append)
    assert outcome.made == ["job0", "job2"]
    assert outcome.failed == {"job1": "is damaged"}
    assert shown == ["job1: is damaged"]
    assert jobs[1].finished == 0


@pytest.mark.parametrize(
    "error", [FileNotFoundError("gone"), FileExistsError("whole"), ValueError("damaged")]
)
@pytest.mark.parametrize("place", ["compute", "finish"])
def test_a_result_that_another_process_completes_meanwhile_is_no_failure(tmp_path, error, place):
    class LateJob(FakeJob):
        def compute(self, unit, threads, mapped):
            super().compute(unit, threads, mapped)
            if place == "compute" and unit == 1:
                self.complete = is_complete
                raise error

        def finish(self):
            self.complete = is_complete
            raise error

    for is_complete in (True, False):
        job, shown = LateJob("late", tmp_path / "late.zarr"), []
        outcome = run_jobs([job, *jobs_in(tmp_path, 1)], ThisProcess(), warn=shown.append)
        assert outcome.made == ["job0"]
        assert job.computed == ([0, 1] if place == "compute" else [0, 1, 2])
        assert outcome.elsewhere == (["late"] if is_complete else [])
        assert outcome.failed == ({} if is_complete else {"late": str(error)})
        assert len(shown) == len(outcome.failed)


def test_an_error_of_the_disk_is_a_failure_also_if_the_result_is_there(tmp_path):
    class FullDiskJob(FakeJob):
        def finish(self):
            self.complete = True
            raise OSError(errno.EIO, "Input/output error")

    outcome = run_jobs([FullDiskJob("job", tmp_path / "a.zarr")], ThisProcess())
    assert outcome.elsewhere == []
    assert "Input/output error" in outcome.failed["job"]


def test_complete_results_are_not_made_again_and_killed_runs_continue(tmp_path):
    jobs = jobs_in(tmp_path)
    jobs[0].complete = True
    jobs[1].computed = [0, 2]
    outcome = run_jobs(jobs, ThisProcess())
    assert outcome.existed == ["job0"]
    assert jobs[0].computed == []
    assert jobs[1].computed == [0, 2, 1]


@pytest.mark.parametrize("total", [2, 3, 64])
def test_parts_together_compute_each_unit_once(tmp_path, total):
    jobs = jobs_in(tmp_path, units=10)
    for number in range(1, total + 1):
        part = Part(number, total)
        numbers = [i for i in range(3) if part.has_capture(i, 3)]
        run_jobs([jobs[i] for i in numbers], ThisProcess(), part=part, numbers=numbers, captures=3)
    assert [sorted(job.computed) for job in jobs] == [list(range(10))] * 3
    # Only where a part has whole captures, it completes them.
    assert [job.finished for job in jobs] == [int(total <= 3)] * 3


def test_the_part_that_has_the_only_unit_of_a_result_completes_it(tmp_path):
    jobs = jobs_in(tmp_path, number=2, units=1, is_single=True)
    outcomes = [run_jobs(jobs, ThisProcess(), part=Part(number, 4)) for number in (1, 2, 3, 4)]
    assert [outcome.made for outcome in outcomes] == [["job0"], ["job1"], [], []]
    assert not any(outcome.partial for outcome in outcomes)


def test_a_part_without_units_of_a_video_has_not_made_it(tmp_path):
    jobs = jobs_in(tmp_path, number=1, units=2)
    outcomes = [run_jobs(jobs, ThisProcess(), part=Part(number, 4)) for number in (3, 4, 1, 2)]
    assert [outcome.partial for outcome in outcomes] == [[], [], ["job0"], ["job0"]]


def test_results_of_other_runs_stop_the_run_before_work(tmp_path):
    jobs = jobs_in(tmp_path)
    jobs[2].foreign = True
    with pytest.raises(AnotherRunError):
        run_jobs(jobs, ThisProcess())
    assert not any(job.computed for job in jobs)


def test_equal_outputs_are_refused(tmp_path):
    jobs = jobs_in(tmp_path, 2)
    jobs[1].output = jobs[0].output
    with pytest.raises(AnotherRunError, match="is the output of both job0 and job1"):
        run_jobs(jobs, ThisProcess())


def test_results_that_do_not_fit_on_the_disk_are_refused(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(
        "jotlight.disk_space.shutil.disk_usage", lambda folder: usage(4 << 30, 1 << 30, 3 << 30)
    )
    jobs = jobs_in(tmp_path / "new" / "folder", nbytes=1 << 30)
    with pytest.raises(OSError, match=r"need up to 3 GiB, and 64 MiB must .* only 3 GiB"):
        run_jobs(jobs, ThisProcess())
    jobs[0].complete = True
    assert len(run_jobs(jobs, ThisProcess()).made) == 2


@pytest.mark.parametrize(
    ("package", "use"),
    [
        ("distributed", lambda: connected(None, 2).__enter__()),
        ("fsspec", lambda: open_capture("s3://bucket/a.npy")),
    ],
)
def test_a_missing_extra_is_named_before_work(monkeypatch, package, use):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'jotlight\[dask\]'"):
        use()


def test_a_worker_of_another_version_is_refused(tmp_path):
    (job,) = jobs_in(tmp_path, 1)
    with pytest.raises(RuntimeError, match=r"expected jotlight 0.0.1 on each worker"):
        compute_unit(job, 0, "0.0.1")
    assert job.computed == []


def test_a_worker_returns_the_warnings_of_a_unit(tmp_path, recwarn):
    (job,) = jobs_in(tmp_path, 1)
    job.compute = lambda unit, threads, mapped: [warn("a dead jot") for _ in range(2)]
    assert compute_unit(job, 0, __version__) == ["a dead jot"]
    assert len(recwarn) == 0
