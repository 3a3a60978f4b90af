"""TIFF files of many pages: each thread reads their directories once, also of damaged files."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import tifffile

import jotlight as jl
from examples.arrays import random_frames
from jotlight.formats.images import kept_directories

FRAMES = random_frames((40, 9, 20))


@pytest.fixture
def opened(monkeypatch):
    """Return a list that grows with each reading of the directories after the capture is opened."""
    paths = []
    original = kept_directories.open_checked_tiff

    def open_checked_tiff(path):
        paths.append(path)
        return original(path)

    monkeypatch.setattr(kept_directories, "open_checked_tiff", open_checked_tiff)
    return paths


def write(path, frames, **options):
    tifffile.imwrite(path, frames.astype(np.uint8), photometric="minisblack", **options)
    return path


@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}, {"bigtiff": True}])
def test_directories_of_many_pages_are_read_once(tmp_path, opened, options):
    bits = jl.open(write(tmp_path / "a.tif", FRAMES, **options), unpacked=True)
    for index in (39, 0, 17, 17):
        np.testing.assert_array_equal(bits[index], FRAMES[index])
    np.testing.assert_array_equal(bits.to_array(), FRAMES)
    assert len(opened) == 1


def test_each_thread_reads_them_once(tmp_path, opened):
    bits = jl.open(write(tmp_path / "a.tif", FRAMES), unpacked=True)
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(bits.__getitem__, list(range(40)) * 5))
    np.testing.assert_array_equal(found, np.tile(FRAMES, (5, 1, 1)))
    assert 1 <= len(opened) <= 4


def test_those_of_few_pages_are_not_kept(tmp_path, opened):
    bits = jl.open(write(tmp_path / "a.tif", FRAMES[:5]), unpacked=True)
    for index in range(3):
        np.testing.assert_array_equal(bits[index], FRAMES[index])
    assert len(opened) == 3


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs the files of a process")
def test_no_file_stays_open(tmp_path):
    path = write(tmp_path / "a.tif", FRAMES)
    bits = jl.open(path, unpacked=True)
    np.testing.assert_array_equal(bits[3], FRAMES[3])
    links = [os.path.realpath(link) for link in Path("/proc/self/fd").iterdir()]
    assert str(path) not in links


def test_a_file_that_is_replaced_is_refused(tmp_path):
    path = write(tmp_path / "a.tif", FRAMES)
    bits = jl.open(path, unpacked=True)
    np.testing.assert_array_equal(bits[3], FRAMES[3])
    write(tmp_path / "b.tif", ~FRAMES[:, :7])
    (tmp_path / "b.tif").replace(path)
    with pytest.raises(OSError, match="has changed since it was opened"):
        bits[3]


def test_a_damaged_page_is_reported_at_each_reading(tmp_path):
    path = write(tmp_path / "a.tif", FRAMES, compression="zlib")
    with tifffile.TiffFile(path) as file:
        place = file.pages[20].dataoffsets[0]
    content = bytearray(path.read_bytes())
    content[place : place + 4] = b"\xff" * 4
    path.write_bytes(content)
    bits = jl.open(path, unpacked=True)
    np.testing.assert_array_equal(bits[3], FRAMES[3])
    for _ in range(2):
        with pytest.raises(ValueError, match=r"a\.tif: the TIFF file is damaged"):
            bits[20]
    np.testing.assert_array_equal(bits[21], FRAMES[21])
