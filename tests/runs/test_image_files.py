import errno
import os

import numpy as np
import pytest

from folders import size_limit
from jotlight.runs.image_files import ImageFiles, write_image


@pytest.fixture
def files(tmp_path):
    files = ImageFiles(tmp_path, (20, 3, 4), "float32")
    for index in (0, 12):
        write_image(files.path(index), np.full((3, 4), index, np.float32))
    return files


@pytest.mark.parametrize("size", [0, 30, 50])
def test_a_failed_write_states_its_reason(tmp_path, size):
    pytest.importorskip("resource", reason="needs limits of the operating system")
    with size_limit(size), pytest.raises(OSError, match="File too large") as raised:
        write_image(tmp_path / "c.0.0.0", np.zeros((3, 4), np.float32))
    assert (raised.value.errno, raised.value.filename) == (
        errno.EFBIG,
        str(tmp_path / "c.0.0.0"),
    )


def test_only_images_of_the_array_are_found(files):
    content = files.path(0).read_bytes()
    for name in ("c.20.0.0", "c.01.0.0", "c.1.0", "c.1.0.0.0", "xc.1.0.0"):
        (files.folder / name).write_bytes(content)
    files.path(2).write_bytes(content[1:])
    files.path(3).mkdir()
    if hasattr(os, "mkfifo"):
        os.mkfifo(files.path(4))
    assert files.find() == {0, 12}


def test_links_to_images_stay_in_the_folder(files, tmp_path_factory):
    files.path(1).symlink_to(files.path(0))
    assert files.find() == {0, 1, 12}
    outside = tmp_path_factory.mktemp("outside") / "file"
    outside.write_bytes(files.path(0).read_bytes())
    files.path(2).symlink_to(outside)
    with pytest.raises(ValueError, match="outside of the folder"):
        files.find()


@pytest.mark.parametrize("block", [1, 48, 1 << 24])
def test_checksums_are_compared_in_blocks(files, monkeypatch, block):
    monkeypatch.setattr("jotlight.runs.image_files._BLOCK_BYTES", block)
    content = bytearray(files.path(12).read_bytes())
    content[7] ^= 1
    files.path(12).write_bytes(content)
    assert list(files.are_intact([0, 12])) == [True, False]
