"""Limits on the sizes that files claim."""

import zipfile

import numpy as np
import pytest

import jotlight as jl
from examples.encodings import npy_bytes
from jotlight.formats.limits import check_claimed_size


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
