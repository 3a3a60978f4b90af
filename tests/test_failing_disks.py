"""Files on disks that are full, that fail, and that lose their power."""

import errno
import os
from pathlib import Path

import pytest

from folders import file_names
from jotlight.files import (
    atomic_folder,
    atomic_write,
    write_file,
)


class TestPowerFailure:
    """The content must be on the disk before the name leads to it."""

    @pytest.fixture
    def steps(self, monkeypatch):
        """Return a list of the names that were flushed or renamed, in order."""
        steps = []

        def fsync(handle):
            steps.append(("flush", Path(f"/proc/self/fd/{handle}").readlink().name))

        def recorded(rename):
            def step(self, target):
                steps.append(("rename", target.name))
                rename(self, target)

            return step

        monkeypatch.setattr(os, "fsync", fsync)
        for name in ("rename", "replace"):
            monkeypatch.setattr(Path, name, recorded(getattr(Path, name)))
        return steps

    pytestmark = pytest.mark.skipif(
        not Path("/proc/self/fd").is_dir(), reason="needs the names of open files"
    )

    def test_a_file_is_flushed_then_renamed_then_its_folder_is_flushed(self, tmp_path, steps):
        with atomic_write(tmp_path / "a") as temporary:
            temporary.write_text("all")
        assert steps == [("flush", temporary.name), ("rename", "a"), ("flush", tmp_path.name)]

    def test_a_file_that_can_be_made_again_is_only_renamed(self, tmp_path, steps):
        with atomic_write(tmp_path / "a", durable=False) as temporary:
            temporary.write_text("all")
        write_file(tmp_path / "b", "all", durable=False)
        assert steps == [("rename", "a"), ("rename", "b")]
        assert (tmp_path / "a").read_text() == (tmp_path / "b").read_text() == "all"

    def test_every_file_of_a_folder_is_flushed_before_it_is_renamed(self, tmp_path, steps):
        with atomic_folder(tmp_path / "set") as temporary:
            (temporary / "inner").mkdir()
            (temporary / "inner" / "a").write_text("all")
            (temporary / "b").write_text("all")
        flushed = {("flush", name) for name in ("a", "b", "inner", temporary.name)}
        assert set(steps[:4]) == flushed
        assert steps[4:] == [("rename", "set"), ("flush", tmp_path.name)]


def failing(number):
    def fsync(handle):
        raise OSError(number, os.strerror(number))

    return fsync


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
@pytest.mark.parametrize("create", [atomic_write, atomic_folder])
def test_a_disk_that_fails_at_the_end_leaves_everything_as_before(
    tmp_path, monkeypatch, number, create
):
    path = tmp_path / "note"
    if create is atomic_write:
        path.write_text("old")
    before = file_names(tmp_path)
    monkeypatch.setattr(os, "fsync", failing(number))
    with pytest.raises(OSError, match="cannot write") as caught, create(path):
        pass
    assert (caught.value.errno, caught.value.strerror) == (
        number,
        f"cannot write {path}: {os.strerror(number)}",
    )
    assert file_names(tmp_path) == before
    assert create is atomic_folder or path.read_text() == "old"


def test_a_file_system_that_cannot_flush_is_no_error(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", failing(errno.EINVAL))
    write_file(tmp_path / "a", "all")
    assert file_names(tmp_path) == ["a"]


def fail(path, error, cause=None):
    with atomic_write(path) as temporary:
        if callable(error):
            error = error(temporary)
        raise error from cause


FULL = OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_write_that_fails_for_lack_of_space_names_the_file(tmp_path, number):
    with pytest.raises(OSError, match=f"cannot write {tmp_path / 'a'}: {os.strerror(number)}$"):
        fail(tmp_path / "a", OSError(number, "in the words of a library"))


@pytest.mark.parametrize("error", [RuntimeError, KeyError, ValueError, MemoryError])
def test_the_reason_inside_another_error_is_found(tmp_path, error):
    with pytest.raises(OSError, match=f"cannot write {tmp_path / 'a'}: No space"):
        fail(tmp_path / "a", error("encoder error"), FULL)


def test_an_error_that_names_the_temporary_file_names_the_file_instead(tmp_path):
    with pytest.raises(OSError, match=f"cannot write {tmp_path / 'a'}: Input/output error$"):
        fail(tmp_path / "a", lambda t: OSError(errno.EIO, "Input/output error", str(t)))


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.EIO, "Input/output error"),
        OSError(errno.ENOSPC, "No space left on device", "another file"),
        OSError(errno.ENOSPC, "cannot write another file: No space left on device"),
        ValueError("image: expected numbers"),
    ],
)
def test_an_error_that_is_not_of_this_file_passes_unchanged(tmp_path, error):
    with pytest.raises(type(error)) as caught:
        fail(tmp_path / "a", error)
    assert caught.value is error
