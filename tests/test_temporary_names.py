"""Names of temporary files, and what killed processes left."""

import contextlib
import errno
import os
import signal
import subprocess
import sys

import pytest

from folders import file_names
from jotlight import temporary_names
from jotlight.temporary_names import reserve_temporary

fcntl = pytest.importorskip("fcntl", reason="needs locks of files")

KILLED = """
import contextlib, os, pathlib, signal, sys
from jotlight.temporary_names import reserve_temporary
with contextlib.ExitStack() as stack:
    for name in sys.argv[1:]:
        temporary = stack.enter_context(reserve_temporary(pathlib.Path(name)))
        if temporary.suffix:
            temporary.write_text("half")
        else:
            (temporary / "inner").mkdir(parents=True)
            (temporary / "inner" / "part").write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def leave_behind(folder, *targets):
    """Leave the temporary files and folders of a process that is killed while it writes."""
    ended = subprocess.run([sys.executable, "-c", KILLED, *targets], cwd=folder, check=False)
    assert ended.returncode == -signal.SIGKILL
    return file_names(folder)


def test_a_temporary_file_has_the_ending_of_its_target_and_is_hidden(tmp_path):
    with reserve_temporary(tmp_path / "note.txt") as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".txt"
        assert temporary.name.startswith(".note.jotlight-")
        assert not temporary.exists()
        temporary.write_text("half")
    assert file_names(tmp_path) == []


def test_what_killed_processes_left_is_removed(tmp_path):
    left = leave_behind(tmp_path, "note.txt", "note.txt", "folder", "other.txt")
    assert len(left) == 8
    with reserve_temporary(tmp_path / "note.txt"), reserve_temporary(tmp_path / "folder"):
        assert all(name.endswith(".lock") or "other" in name for name in file_names(tmp_path))
    assert file_names(tmp_path) == [name for name in left if "other" in name]


@pytest.mark.slow
def test_a_file_that_a_living_process_writes_is_kept(tmp_path):
    leave_behind(tmp_path, "note.txt")
    with reserve_temporary(tmp_path / "note.txt") as first:
        first.write_text("first")
        with reserve_temporary(tmp_path / "note.txt") as second:
            assert second != first
            second.write_text("second")
        assert first.read_text() == "first"
        code = "import pathlib; from jotlight.temporary_names import reserve_temporary as r\n"
        code += "with r(pathlib.Path('note.txt')) as t: print(t)"
        run = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        assert run.stdout.strip() == second.name
        assert first.read_text() == "first"
    assert file_names(tmp_path) == []


def unsupported(*_):
    raise OSError(errno.ENOLCK, "No locks available")


def no_fcntl(patch):
    patch.setattr(temporary_names, "fcntl", None)


def no_locks(patch):
    patch.setattr(fcntl, "flock", unsupported)


@pytest.mark.parametrize("without", [no_fcntl, no_locks])
def test_without_locks_names_are_random_and_nothing_is_removed(tmp_path, monkeypatch, without):
    with reserve_temporary(tmp_path / "note.txt") as leftover:
        pass
    leftover.write_text("half")
    without(monkeypatch)
    with contextlib.ExitStack() as stack:
        found = {stack.enter_context(reserve_temporary(tmp_path / "new.txt")) for _ in range(20)}
        assert len(found) == 20
        for path in found:
            path.write_text("half")
        stack.enter_context(reserve_temporary(tmp_path / "note.txt"))
    assert not any(path.exists() for path in found)
    assert file_names(tmp_path) == [leftover.name]


def lock_name(folder):
    with reserve_temporary(folder / "note.txt") as temporary:
        return temporary.with_name(f"{temporary.name}.lock")


def test_a_link_that_somebody_planted_is_not_followed(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("precious")
    lock = lock_name(tmp_path)
    lock.symlink_to(victim)
    with reserve_temporary(tmp_path / "note.txt") as temporary:
        assert "-1." in temporary.name
        temporary.write_text("ours")
    assert victim.read_text() == "precious"
    assert file_names(tmp_path) == [lock.name, "victim"]


def test_a_file_of_another_user_is_left_alone(tmp_path, monkeypatch):
    lock = lock_name(tmp_path)
    lock.touch()
    real = os.open

    def refuse(path, *arguments):
        if path == lock:
            raise PermissionError(errno.EACCES, "Permission denied")
        return real(path, *arguments)

    monkeypatch.setattr(os, "open", refuse)
    with reserve_temporary(tmp_path / "note.txt") as temporary:
        assert "-1." in temporary.name
    assert file_names(tmp_path) == [lock.name]


def test_a_lock_that_its_owner_deletes_meanwhile_is_taken_anew(tmp_path, monkeypatch):
    lock = lock_name(tmp_path)
    real, calls = fcntl.flock, []

    def flock(handle, flags):
        if not calls:
            lock.unlink()
        calls.append(handle)
        real(handle, flags)

    monkeypatch.setattr(fcntl, "flock", flock)
    with reserve_temporary(tmp_path / "note.txt"):
        assert len(calls) == 2
        assert file_names(tmp_path) == [lock.name]
    assert file_names(tmp_path) == []


def test_a_folder_that_refuses_files_raises(tmp_path):
    with pytest.raises(FileNotFoundError), reserve_temporary(tmp_path / "none" / "note.txt"):
        pytest.fail("the block was entered")
