"""The check that outputs fit on their disks."""

import errno
from collections import namedtuple

import pytest

from jotlight.disk_space import check_disk_space
from jotlight.errors import error_message

Usage = namedtuple("Usage", "total used free")


def set_usage(monkeypatch, total, free):
    """Let all disks state these sizes."""
    usage = Usage(total, total - free, free)
    monkeypatch.setattr("jotlight.disk_space.shutil.disk_usage", lambda folder: usage)


def test_the_error_is_that_of_a_failed_write_and_states_the_sizes(tmp_path, monkeypatch):
    set_usage(monkeypatch, 4096, 3000)
    outputs = [(tmp_path / "new" / name, 1024) for name in ("a.npy", "b.npy", "c.npy")]
    check_disk_space(outputs[:2])
    with pytest.raises(OSError, match=r"a\.npy and 2 other outputs: No space left") as caught:
        check_disk_space(outputs)
    assert caught.value.errno == errno.ENOSPC
    assert error_message(caught.value) == (
        f"cannot write {outputs[0][0]} and 2 other outputs: No space left on device; the results "
        f"need up to 3 KiB, but {tmp_path} has only 2.93 KiB of free space; free some space, or "
        "choose another folder"
    )
    with pytest.raises(OSError, match=r"a\.npy: No space .* 1 KiB, and 1.953 KiB must stay free"):
        check_disk_space(outputs[:1], reserve=2000)


def test_a_disk_of_unknown_size_is_not_full(tmp_path, monkeypatch):
    set_usage(monkeypatch, 0, 0)
    check_disk_space([(tmp_path / "a.npy", 1 << 60)])


def test_links_that_form_a_loop_are_an_error_of_the_output(tmp_path):
    path = tmp_path / "a.npy"
    path.symlink_to("a.npy")
    with pytest.raises(OSError, match="its symbolic links form a loop"):
        check_disk_space([(path, 1)])
