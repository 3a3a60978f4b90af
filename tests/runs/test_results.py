import dataclasses
import json
import os
from pathlib import Path

import pytest

from jotlight.runs.records import AnotherRunError
from jotlight.runs.results import RecordedResult, measure

RUN = {"method": "mle"}


@dataclasses.dataclass(frozen=True)
class Result(RecordedResult):
    output: Path
    run: dict = dataclasses.field(default_factory=lambda: RUN)

    @property
    def record(self):
        return self.output.with_name(f"{self.output.name}.json")

    def note(self, **facts):
        self.record.write_text(json.dumps(facts))


@pytest.fixture(params=["file", "folder"])
def made(request, tmp_path):
    """Return a complete result: a file, or a folder of two files."""
    result = Result(tmp_path / "result")
    files = [result.output]
    if request.param == "folder":
        (result.output / "c").mkdir(parents=True)
        files = [result.output / "zarr.json", result.output / "c" / "0"]
    for file in files:
        file.write_bytes(bytes(10))
    result.note(run=RUN, output={"files": len(files), "bytes": 10 * len(files)})
    return result


def test_a_result_of_the_stated_size_is_complete(made):
    assert made.is_complete()
    made.finish()
    with pytest.raises(FileExistsError, match="a worker finds it complete"):
        made.refuse_complete()


def test_a_result_of_another_size_is_refused(made):
    path = made.output / "c" / "0" if made.output.is_dir() else made.output
    path.write_bytes(bytes(4))
    with pytest.raises(ValueError, match=r"expected .0 bytes in . files?, .* delete it to make"):
        made.is_complete()
    if made.output.is_dir():
        path.unlink()
        with pytest.raises(ValueError, match=r"got 10 bytes in 1 file; restore it from a copy"):
            made.is_complete()


def test_a_size_that_no_run_writes_is_refused(made):
    made.note(run=RUN, output="large")
    with pytest.raises(ValueError, match=r"expected 'large', which its record states"):
        made.is_complete()


def test_hidden_files_do_not_count(made):
    if made.output.is_dir():
        (made.output / ".DS_Store").write_bytes(b"seen")
        (made.output / "c" / ".backup" / "old").mkdir(parents=True)
        (made.output / "c" / ".backup" / "old" / "0").write_bytes(b"old")
    assert made.is_complete()


def test_the_results_of_other_runs_are_refused(made):
    with pytest.raises(AnotherRunError, match='its method was "mle", and is "small" now'):
        Result(made.output, {"method": "small"}).is_complete()
    made.record.unlink()
    with pytest.raises(AnotherRunError, match="exists already, and is not the result of such"):
        made.is_complete()


@pytest.mark.parametrize("run", [RUN, {"method": "small"}])
def test_a_record_without_a_result_says_nothing(tmp_path, run):
    result = Result(tmp_path / "result")
    result.note(run=run)
    assert not result.is_complete()
    result.refuse_complete()


def test_a_result_whose_record_states_no_size_is_not_complete(made):
    made.note(run=RUN)
    assert not made.is_complete()


def test_other_files_in_the_place_of_the_record_are_refused(tmp_path):
    result = Result(tmp_path / "result")
    result.note(mine=1)
    with pytest.raises(AnotherRunError, match=r"result\.json: exists already"):
        result.is_complete()


def test_a_result_that_is_not_on_this_machine_is_a_failure(tmp_path):
    result = Result(tmp_path / "new" / "result")
    assert result.prepare() == [0]
    with pytest.raises(FileNotFoundError, match="a worker has written it, but it is not on this"):
        result.finish()


def test_a_link_may_lead_into_a_new_folder(tmp_path, monkeypatch):
    target, opened = tmp_path / "new" / "result", []
    link = Result(tmp_path / "link")
    link.output.symlink_to(target)
    link.prepare()
    assert target.parent.is_dir()
    target.write_bytes(bytes(10))
    link.note(run=RUN, output={"files": 1, "bytes": 10})
    scan = os.scandir
    monkeypatch.setattr(os, "scandir", lambda path: opened.append(path) or scan(path))
    link.finish()
    assert opened[0] == target.parent


def test_files_beside_a_result_belong_to_its_size(made):
    size = measure(made.output)
    other = measure(made.output, [made.record, made.output.with_name("missing")])
    assert other["files"] == size["files"] + 1
    assert other["bytes"] == size["bytes"] + made.record.stat().st_size
