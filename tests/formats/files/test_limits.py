"""Limits on the sizes that files claim."""

import zipfile

import numpy as np
import pytest

import jotlight as jl
from examples.encodings import npy_bytes
from jotlight.formats.files.limits import check_claimed_size


@pytest.mark.parametrize(("frame_bytes", "file_bytes"), [(1 << 26, 1), ((1 << 26) + 500, 5)])
def test_frames_within_the_limit_are_accepted(frame_bytes, file_bytes):
    check_claimed_size("a", 0, file_bytes, frame_bytes=frame_bytes)


@pytest.mark.parametrize(("frame_bytes", "file_bytes"), [((1 << 26) + 1, 0), ((1 << 26) + 501, 5)])
def test_large_frames_of_small_files_are_refused(frame_bytes, file_bytes):
    with pytest.raises(ValueError, match=rf"a: .*got {frame_bytes}; .* store it uncompressed"):
        check_claimed_size("a", 0, file_bytes, frame_bytes=frame_bytes)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_archives_that_python_decompresses_without_a_limit_are_refused(tmp_path, method):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", method) as archive:
        archive.writestr("a.npy", npy_bytes(np.ones((3, 4), int)))
    with pytest.raises(ValueError, match=r"a\.npz: .*a\.npy .*numpy\.savez_compressed"):
        jl.open(tmp_path / "a.npz")


@pytest.mark.parametrize(("claimed", "file_bytes"), [(1 << 28, 10**6), ((1 << 28) + 10**8, 10**6)])
def test_arrays_that_are_read_as_a_whole_have_a_limit(claimed, file_bytes):
    check_claimed_size("a", claimed, file_bytes, whole=True)
    check_claimed_size("a", claimed + 10**8 + 1, file_bytes)
    with pytest.raises(ValueError, match=r"a: .*got \d+, which are read as a whole; .* in parts"):
        check_claimed_size("a", claimed + 10**8 + 1, file_bytes, whole=True)
