"""The state of the files of a capture."""

from pathlib import Path

import pytest

import jotlight as jl
from jotlight.formats.locations import files_state


def test_links_to_nothing_in_a_folder_do_not_count(tmp_path):
    (tmp_path / "a.png").write_bytes(b"123")
    number, size, latest = files_state(tmp_path)
    (tmp_path / ".#a.png").symlink_to("nothing")
    assert (number, size) == (1, 3)
    assert files_state(tmp_path) == (number, size, latest)


def test_a_missing_capture_has_no_state(tmp_path):
    with pytest.raises(FileNotFoundError):
        files_state(tmp_path / "a.npy")


def test_a_pattern_where_one_file_is_expected_has_advice(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"a\*\.npy; a pattern of several.*: name one; "):
        jl.open(tmp_path / "a*.npy")
    with pytest.raises(FileNotFoundError, match=r"a\.npy$"):
        jl.open(tmp_path / "a.npy")


def test_a_url_as_a_path_has_advice():
    with pytest.raises(FileNotFoundError, match=r"jotlight\.open with a text take a URL$"):
        jl.open(Path("s3://bucket/a.npy"))
