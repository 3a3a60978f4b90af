"""The processes of pytest waste no time."""

import gc
import os
from pathlib import Path

import pytest


def test_the_search_for_garbage_ignores_the_objects_of_the_collection():
    assert gc.isenabled()
    assert gc.get_threshold()[0] > 0
    assert gc.get_freeze_count() > 100_000


def test_files_are_not_flushed_and_closed_files_are_an_error(tmp_path):
    with (tmp_path / "a").open("wb") as file:
        handle = file.fileno()
        os.fsync(handle)
    assert os.fsync is os.fstat
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fsync(handle)


@pytest.mark.skipif(
    "PYTEST_XDIST_WORKER" not in os.environ or not Path("/proc/self/environ").exists(),
    reason="needs a process of several, and its first environment",
)
def test_linear_algebra_uses_one_thread_from_the_start():
    assert b"\0OPENBLAS_NUM_THREADS=1\0" in b"\0" + Path("/proc/self/environ").read_bytes()
