"""Equal jobs at once, and jobs whose process was killed: complete folders are never replaced."""

import json
import shutil

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.npy.description import description_path
from jotlight.runs import jobs as module
from jotlight.runs.capture_source import CaptureSource
from jotlight.runs.estimator import choose_estimator
from jotlight.runs.jobs import ConversionJob, ImageJob

RUN = {"capture": "a"}

COPIES = pytest.mark.parametrize(
    ("name", "to"), [("c.zarr", "zarr"), ("c.h5", "hdf5"), ("c.npy", "npy"), ("c.npy.gz", "npy.gz")]
)


@pytest.fixture
def source(tmp_path):
    sensor = jl.Sensor(frames=8, dark_counts=np.full((6, 13), 0.01))
    jl.save(sensor.expose(np.full((6, 13), 0.5), rng=0), tmp_path / "a.npy")
    return CaptureSource.of(str(tmp_path / "a.npy"), ReadingOptions())


def conversion(source, output, to):
    return ConversionJob("a", source, output, to, RUN, 0)


def image(source, output):
    estimator = choose_estimator(source.open().sensor, "mle", None, {})
    return ImageJob(
        name="a",
        capture=source,
        frames=8,
        oversampling=1,
        estimator=estimator,
        output=output,
        run=RUN,
        nbytes=0,
    )


def state(folder):
    """Return the content and the inode of each file, except of the capture."""
    return {
        path: (path.read_bytes(), path.stat().st_ino)
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith("a.")
    }


def is_about(path, job):
    """Return whether a file is the record of a copy, or its description."""
    return path == job.record or (path.suffix == ".json" and path.parent == job.output.parent)


@COPIES
def test_the_record_of_a_copy_states_its_size(source, tmp_path, name, to):
    job = conversion(source, tmp_path / name, to)
    job.compute(0, None, False)
    assert job.is_complete()
    files = [path for path in state(tmp_path) if not is_about(path, job)]
    stated = json.loads(job.record.read_text())["output"]
    assert stated == {"files": len(files), "bytes": sum(path.stat().st_size for path in files)}
    files[-1].write_bytes(b"")
    with pytest.raises(ValueError, match="which its record states"):
        job.is_complete()


@COPIES
def test_a_copy_that_another_process_has_completed_stays(source, tmp_path, name, to):
    job = conversion(source, tmp_path / name, to)
    job.compute(0, None, False)
    before = state(tmp_path)
    with pytest.raises(FileExistsError, match="a worker finds it complete"):
        job.compute(0, None, False)
    assert state(tmp_path) == before


@COPIES
def test_another_process_may_complete_the_copy_meanwhile(source, tmp_path, name, to, monkeypatch):
    job = conversion(source, tmp_path / name, to)
    write = module.write_capture

    def write_later(*arguments):
        monkeypatch.setattr(module, "write_capture", write)
        job.compute(0, None, False)
        before.update(state(tmp_path))
        write(*arguments)

    before = {}
    monkeypatch.setattr(module, "write_capture", write_later)
    with pytest.raises(FileExistsError, match="a worker finds it complete"):
        job.compute(0, None, False)
    assert job.is_complete()
    after = state(tmp_path)
    assert {path: content for path, (content, _) in after.items()} == {
        path: content for path, (content, _) in before.items()
    }
    assert after == before or job.output.is_file()


@COPIES
def test_a_record_that_was_not_completed_is_completed(source, tmp_path, name, to):
    job = conversion(source, tmp_path / name, to)
    job.compute(0, None, False)
    before = state(tmp_path)
    complete = json.loads(job.record.read_text())
    job.record.write_text(json.dumps({"run": RUN}))
    assert not job.is_complete()
    job.compute(0, None, False)
    assert json.loads(job.record.read_text()) == complete
    if job.output.is_dir():
        kept = {path: value for path, value in before.items() if path != job.record}
        assert state(job.output) == kept


@pytest.mark.parametrize("damage", ["deleted", "changed", "other"])
def test_a_damaged_folder_whose_record_states_no_size_is_refused(source, tmp_path, damage):
    job = conversion(source, tmp_path / "c.zarr", "zarr")
    job.compute(0, None, False)
    job.record.write_text(json.dumps({"run": RUN}))
    chunk = max(job.output.rglob("c/*/*/*"))
    if damage == "deleted":
        chunk.unlink()
    elif damage == "changed":
        chunk.write_bytes(bytes(chunk.stat().st_size))
    else:
        shutil.rmtree(job.output)
        jl.save(jl.Bits.from_array(np.ones((8, 6, 13), bool), jl.Sensor(frames=8)), job.output)
    with pytest.raises(
        ValueError, match=r"its record states no size; got: .* delete it to make it"
    ):
        job.compute(0, None, False)
    assert json.loads(job.record.read_text()) == {"run": RUN}


@pytest.mark.parametrize(("name", "to"), [("c.npy", "npy"), ("c.npy.gz", "npy.gz")])
def test_the_description_of_a_complete_copy_may_be_changed(source, tmp_path, name, to):
    job = conversion(source, tmp_path / name, to)
    job.compute(0, None, False)
    description = description_path(job.output)
    content = json.loads(description.read_text())
    del content["checksum"]
    description.write_text(json.dumps(content))
    assert job.is_complete()


@COPIES
@pytest.mark.parametrize("change", [0, 1])
def test_a_copy_that_was_deleted_is_made_again(source, tmp_path, name, to, change):
    job = conversion(source, tmp_path / name, to)
    job.compute(0, None, False)
    record = json.loads(job.record.read_text())
    size = record["output"]
    stale = {**record, "output": {**size, "bytes": size["bytes"] + change}}
    job.record.write_text(json.dumps(stale))
    shutil.rmtree(job.output) if job.output.is_dir() else job.output.unlink()
    job.compute(0, None, False)
    job.finish()
    assert json.loads(job.record.read_text()) == record


def test_a_failed_copy_leaves_the_way_free_for_other_runs(source, tmp_path, monkeypatch):
    def fail(*arguments):
        raise OSError("no space")

    job = conversion(source, tmp_path / "c.h5", "hdf5")
    with monkeypatch.context() as context:
        context.setattr(module, "write_capture", fail)
        with pytest.raises(OSError, match="no space"):
            job.compute(0, None, False)
    other = ConversionJob("a", source, job.output, "hdf5", {"capture": "b"}, 0)
    assert not other.is_complete()
    other.compute(0, None, False)
    assert other.is_complete()


def test_an_image_that_another_process_completes_stays(source, tmp_path, monkeypatch):
    job = image(source, tmp_path / "i.tif")
    checksum, before = module.file_checksum, {}

    def checksum_later(path):
        monkeypatch.setattr(module, "file_checksum", checksum)
        job.compute(0, None, False)
        before.update(state(tmp_path))
        return checksum(path)

    monkeypatch.setattr(module, "file_checksum", checksum_later)
    for _ in range(2):
        with pytest.raises(FileExistsError, match="a worker finds it complete"):
            job.compute(0, None, False)
        assert {job.output, job.record} < before.keys()
        assert state(tmp_path) == {path: before[path] for path in (job.output, job.record)}
    job.finish()
    job.output.write_bytes(job.output.read_bytes()[:-1])
    with pytest.raises(ValueError, match="which its record states"):
        job.is_complete()
