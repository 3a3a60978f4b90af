"""Files and folders that appear whole or not at all."""

import os
import stat
from pathlib import Path

import pytest

from folders import file_names
from jotlight.files import (
    atomic_folder,
    atomic_write,
    atomic_write_together,
    check_outputs,
    delete_file,
    write_file,
)
from jotlight.temporary_names import reserve_temporary


def permissions(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_the_file_appears_when_the_block_ends_and_not_before(tmp_path):
    path = tmp_path / "note.txt"
    with atomic_write(path) as temporary:
        temporary.write_text("all")
        assert not path.exists()
        assert (temporary.parent, temporary.suffix) == (tmp_path, ".txt")
    assert path.read_text() == "all"
    assert file_names(tmp_path) == ["note.txt"]


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
    assert file_names(tmp_path) == (["note.txt"] if before else [])
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
    assert file_names(tmp_path) == ["note.txt"]


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


@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_a_new_folder_has_the_permissions_of_any_new_folder(tmp_path, mask):
    before = os.umask(mask)
    try:
        with atomic_folder(tmp_path / "ours"):
            pass
    finally:
        os.umask(before)
    assert permissions(tmp_path / "ours") == 0o777 & ~mask


def test_writing_never_changes_the_mask_which_all_threads_share(tmp_path, monkeypatch):
    changed = []
    monkeypatch.setattr(os, "umask", changed.append)
    with atomic_write(tmp_path / "note.txt") as temporary:
        temporary.write_text("new")
    with atomic_folder(tmp_path / "folder"):
        pass
    assert not changed


@pytest.mark.parametrize("mode", [0o640, 0o600, 0o666])
def test_a_replaced_file_keeps_its_permissions(tmp_path, mode):
    path = tmp_path / "note.txt"
    path.write_text("old")
    path.chmod(mode)
    with atomic_write(path) as temporary:
        assert permissions(temporary) & ~mode == 0  # others cannot read it earlier, either
        temporary.write_text("new")
    assert permissions(path) == mode


def enter(path):
    with atomic_write(path):
        pytest.fail("the block was entered")


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("folder", IsADirectoryError, "folder: it is a folder; pass the name of a file"),
        ("missing/note.txt", FileNotFoundError, "there is no folder .*missing; create it first"),
        ("file/note.txt", OSError, "cannot write .*note.txt: there is no folder"),
        ("s3://bucket/note.txt", ValueError, "are written to files of this machine, not to URLs"),
    ],
)
def test_a_path_that_cannot_be_written_to_is_found_before_any_work(tmp_path, name, error, message):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("x")
    with pytest.raises(error, match=message):
        enter(name if "://" in name else tmp_path / name)
    assert file_names(tmp_path) == ["file", "folder"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a pipe with a name")
def test_a_pipe_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe.npy")
    with pytest.raises(OSError, match=r"pipe\.npy: it is a device or a pipe; pass the name of"):
        enter(tmp_path / "pipe.npy")
    assert (tmp_path / "pipe.npy").is_fifo()


def test_a_name_as_long_as_the_system_allows_is_written(tmp_path):
    path = tmp_path / ("n" * 251 + ".txt")
    with atomic_write(path) as temporary:
        temporary.write_text("x")
    assert file_names(tmp_path) == [path.name]


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
    assert file_names(tmp_path) == ["set"]
    assert permissions(tmp_path / "set") & 0o700 == 0o700
    with (
        pytest.raises(FileExistsError, match="this folder already exists"),
        atomic_folder(tmp_path / "set"),
    ):
        pass


def test_a_half_written_folder_is_removed(tmp_path):
    def interrupted():
        with atomic_folder(tmp_path / "set") as temporary:
            (temporary / "a").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert file_names(tmp_path) == []


@pytest.mark.parametrize("content", ["größer", b"\x00\xff"])
def test_content_is_written_as_it_is(tmp_path, content):
    write_file(tmp_path / "a", content)
    encoded = content.encode() if isinstance(content, str) else content
    assert (tmp_path / "a").read_bytes() == encoded
    assert file_names(tmp_path) == ["a"]


def test_a_temporary_file_is_itself_written_in_place(tmp_path):
    with atomic_write(tmp_path / "a") as temporary:
        before = temporary.stat().st_ino
        write_file(temporary, "all")
        assert temporary.stat().st_ino == before
    assert (tmp_path / "a").read_text() == "all"


def leave_temporary(path):
    """Write a file, and leave what a killed process leaves beside it."""
    path.write_text("old")
    with reserve_temporary(path) as temporary:
        pass
    temporary.write_text("half")
    temporary.with_name(f"{temporary.name}.lock").touch()


def test_deleting_a_file_also_deletes_what_killed_processes_left(tmp_path):
    leave_temporary(tmp_path / "a")
    delete_file(tmp_path / "a")
    assert file_names(tmp_path) == []


def test_deleting_a_link_deletes_the_file_to_which_it_leads(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to("disk/a")
    leave_temporary(tmp_path / "disk" / "a")
    for _ in range(2):
        delete_file(tmp_path / "link")
        assert file_names(tmp_path / "disk") == []
    assert (tmp_path / "link").is_symlink()


@pytest.mark.parametrize("exists", [False, True])
@pytest.mark.parametrize("second", ["a.npy", "./a.npy", "sub/../a.npy"])
def test_outputs_of_the_same_name_are_refused(tmp_path, monkeypatch, second, exists):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    if exists:
        (tmp_path / "a.npy").touch()
    check_outputs([Path("a.npy"), None, Path("b.npy")], [None, Path("missing.npy")])
    with pytest.raises(ValueError, match="a different name for each output"):
        check_outputs([Path("a.npy"), Path(second)], [])


@pytest.mark.parametrize("name", ["read.npy", "link.npy"])
def test_an_output_that_is_an_input_is_refused(tmp_path, name):
    (tmp_path / "read.npy").touch()
    (tmp_path / "link.npy").symlink_to("read.npy")
    with pytest.raises(ValueError, match=f"{name}: this file is read"):
        check_outputs([tmp_path / "new.npy", tmp_path / name], [tmp_path / "read.npy"])


@pytest.mark.parametrize("old", ["old", None])
@pytest.mark.parametrize("together", [False, True])
def test_an_output_that_is_a_link_is_written_where_it_leads(tmp_path, old, together):
    (tmp_path / "disk").mkdir()
    target, link = tmp_path / "disk" / "real.txt", tmp_path / "link.txt"
    link.symlink_to("disk/real.txt")
    if old is not None:
        target.write_text(old)
        target.chmod(0o640)
    write = atomic_write_together([link]) if together else atomic_write(link)
    with write as temporary:
        [temporary] = temporary if together else [temporary]
        assert temporary.parent == target.parent
        temporary.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert old is None or permissions(target) == 0o640
    assert file_names(tmp_path / "disk") == ["real.txt"]


def test_a_folder_is_written_where_a_link_leads(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to("disk/film")
    with atomic_folder(tmp_path / "link") as temporary:
        (temporary / "a").write_text("new")
    assert (tmp_path / "disk" / "film" / "a").read_text() == "new"
    assert (tmp_path / "link").is_symlink()
    with pytest.raises(FileExistsError, match="this folder already exists"):
        enter_folder(tmp_path / "link")


def enter_folder(path):
    with atomic_folder(path):
        pass


@pytest.mark.parametrize("name", ["a.npy", "a.npy/c.npy"])
def test_outputs_whose_links_form_a_loop_are_refused(tmp_path, name):
    (tmp_path / "a.npy").symlink_to("b.npy")
    (tmp_path / "b.npy").symlink_to("a.npy")
    with pytest.raises(OSError, match=f"cannot write .*{name}: its symbolic links form a loop"):
        check_outputs([tmp_path / name], [])


def test_links_that_lead_nowhere_are_refused(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OSError, match="loop: its symbolic links form a loop"):
        enter(tmp_path / "loop")
    (tmp_path / "lost").symlink_to("missing/real.txt")
    with pytest.raises(FileNotFoundError, match=r"real\.txt: there is no folder .*missing"):
        enter(tmp_path / "lost")
    assert file_names(tmp_path) == ["loop", "lost"]
