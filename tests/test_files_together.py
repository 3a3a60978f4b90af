"""Outputs with files beside them, such as records, and outputs of two processes at once."""

import errno

import pytest

from jotlight.files import atomic_folder, atomic_write_together, write_file


def test_a_failed_write_beside_an_output_names_the_output(tmp_path):
    output, record = tmp_path / "a.npy", tmp_path / "a.npy.json"
    with (
        pytest.raises(OSError, match=r"cannot write .*a\.npy: No space left on device"),
        atomic_write_together([output], [record]) as (_, text),
    ):
        raise OSError(errno.ENOSPC, "No space left on device", str(text))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_writable_is_an_error_of_the_output(tmp_path, monkeypatch):
    output, record = tmp_path / "a.npy", tmp_path / "a.npy.json"

    def refuse(*arguments):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("jotlight.files.reserve_temporary", refuse)
    message = r"cannot write .*a\.npy: Permission denied in folder"
    with pytest.raises(PermissionError, match=message):
        write_file(record, "{}", output=output)


def test_a_folder_that_another_process_writes_meanwhile_is_kept(tmp_path):
    def write_twice():
        with atomic_folder(tmp_path / "set") as temporary:
            (temporary / "a").write_text("mine")
            with atomic_folder(tmp_path / "set") as other:
                (other / "a").write_text("other")

    with pytest.raises(
        FileExistsError, match=r"cannot write .*set: this folder already exists; ch"
    ):
        write_twice()
    assert (tmp_path / "set" / "a").read_text() == "other"
    assert [each.name for each in tmp_path.iterdir()] == ["set"]
