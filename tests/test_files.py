"""Files and folders that appear whole or not at all."""

import os
import stat
from pathlib import Path

import pytest

from jotlight.files import atomic_folder, atomic_write


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def permissions(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_the_file_appears_when_the_block_ends_and_not_before(tmp_path):
    path = tmp_path / "note.txt"
    with atomic_write(path) as temporary:
        temporary.write_text("all")
        assert not path.exists()
        assert (temporary.parent, temporary.suffix) == (tmp_path, ".txt")
    assert path.read_text() == "all"
    assert names(tmp_path) == ["note.txt"]


def test_a_path_may_be_a_string_in_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with atomic_write("note.txt") as temporary:
        temporary.write_text("all")
    assert (tmp_path / "note.txt").read_text() == "all"


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("before", [None, "old"])
def test_an_interrupted_block_keeps_the_old_file(tmp_path, error, before):
    path = tmp_path / "note.txt"
    if before:
        path.write_text(before)

    def interrupted():
        with atomic_write(path) as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        interrupted()
    assert names(tmp_path) == (["note.txt"] if before else [])
    assert not before or path.read_text() == before


def test_an_old_file_stays_until_the_block_ends(tmp_path):
    path = tmp_path / "note.txt"
    path.write_text("old")
    with atomic_write(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"


def test_a_temporary_file_that_was_removed_is_an_error_and_leaves_the_old_file(tmp_path):
    path = tmp_path / "note.txt"
    path.write_text("old")
    with pytest.raises(FileNotFoundError), atomic_write(path) as temporary:
        temporary.unlink()
    assert names(tmp_path) == ["note.txt"]


@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_a_new_file_has_the_permissions_of_any_new_file(tmp_path, mask):
    before = os.umask(mask)
    try:
        with atomic_write(tmp_path / "ours") as temporary:
            temporary.write_text("x")
        (tmp_path / "plain").write_text("x")
        assert os.umask(mask) == mask
    finally:
        os.umask(before)
    assert permissions(tmp_path / "ours") == permissions(tmp_path / "plain") == 0o666 & ~mask


def test_a_replaced_file_keeps_its_permissions(tmp_path):
    path = tmp_path / "note.txt"
    path.write_text("old")
    path.chmod(0o640)
    with atomic_write(path) as temporary:
        temporary.write_text("new")
    assert permissions(path) == 0o640


def enter(path):
    with atomic_write(path):
        pytest.fail("the block was entered")


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("folder", IsADirectoryError, "folder: it is a folder; pass the name of a file"),
        ("missing/note.txt", FileNotFoundError, "there is no folder .*missing; create it first"),
        ("file/note.txt", OSError, "cannot write .*note.txt: there is no folder"),
    ],
)
def test_a_path_that_cannot_be_written_to_is_found_before_any_work(tmp_path, name, error, message):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("x")
    with pytest.raises(error, match=message):
        enter(tmp_path / name)
    assert names(tmp_path) == ["file", "folder"]


def test_a_name_as_long_as_the_system_allows_is_written(tmp_path):
    path = tmp_path / ("n" * 251 + ".txt")
    with atomic_write(path) as temporary:
        temporary.write_text("x")
    assert names(tmp_path) == [path.name]


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that refuses files")
def test_a_folder_that_refuses_files_is_found_before_any_work():
    with pytest.raises(OSError, match=r"cannot write .*note\.txt: .* in folder"):
        enter("/proc/self/note.txt")


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_file_or_folder_is_refused(tmp_path):
    path = tmp_path / "note.txt"
    path.write_text("old")
    path.chmod(0o400)
    with pytest.raises(PermissionError, match="the file is read-only"):
        enter(path)
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError, match=r"cannot write .* in folder"):
        enter(tmp_path / "new.txt")
    tmp_path.chmod(0o700)


def test_a_folder_appears_when_the_block_ends_and_not_before(tmp_path):
    with atomic_folder(tmp_path / "set") as temporary:
        (temporary / "a").write_text("all")
        assert not (tmp_path / "set").exists()
    assert names(tmp_path) == ["set"]
    assert permissions(tmp_path / "set") & 0o700 == 0o700
    with pytest.raises(FileExistsError, match="it already exists"), atomic_folder(tmp_path / "set"):
        pass


def test_a_half_written_folder_is_removed(tmp_path):
    def interrupted():
        with atomic_folder(tmp_path / "set") as temporary:
            (temporary / "a").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert names(tmp_path) == []
