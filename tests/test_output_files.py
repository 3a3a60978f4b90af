"""Files that libraries write to."""

import errno
import io

import numpy as np
import pytest

from folders import size_limit
from jotlight.output_files import described_error, open_output

pytest.importorskip("resource", reason="needs limits of the operating system")


def test_everything_written_is_in_the_file_in_its_order(tmp_path):
    with open_output(tmp_path / "a") as file:
        file.write(b"0123456789")
        file.seek(2)
        file.write(b"ab")
        file.seek(0)
        assert file.read(4) == b"01ab"
    assert (tmp_path / "a").read_bytes() == b"01ab456789"


def test_no_library_finds_the_descriptor(tmp_path):
    with open_output(tmp_path / "a") as file, pytest.raises(io.UnsupportedOperation):
        file.fileno()


def fill(path, limit, write, **options):
    with size_limit(limit), open_output(path, **options) as file:
        write(file)


@pytest.mark.parametrize("missing", [1, 100, 1000])
def test_the_error_of_a_failed_write_has_the_reason_and_the_name(tmp_path, missing):
    path = tmp_path / "a.npy"
    array = np.arange(1000)
    size = 128 + array.nbytes
    fill(path, size, lambda file: np.save(file, array))
    with pytest.raises(OSError, match="File too large") as caught:
        fill(path, size - missing, lambda file: np.save(file, array))
    assert caught.value.errno == errno.EFBIG
    assert caught.value.filename == str(path)


def test_the_reason_replaces_the_error_that_a_library_makes_of_it(tmp_path):
    def write(file):
        try:
            file.write(bytes(100_000))
        except OSError:
            raise RuntimeError("could not compress") from None

    with pytest.raises(OSError, match="File too large"):
        fill(tmp_path / "a", 10, write)


def test_another_error_passes_unchanged(tmp_path):
    def write(file):
        raise RuntimeError("could not compress")

    with pytest.raises(RuntimeError, match="could not compress"):
        fill(tmp_path / "a", 10, write)


class TestPostponedErrors:
    def test_the_library_sees_success_and_the_block_raises(self, tmp_path):
        done = []

        def write(file):
            assert file.write(bytes(100_000)) == 100_000
            file.flush()
            assert file.truncate(200_000) == 200_000
            with pytest.raises(OSError, match="File too large"):
                file.check()
            done.append(True)

        with pytest.raises(OSError, match="File too large"):
            fill(tmp_path / "a", 10, write, postpone_errors=True)
        assert done

    def test_a_file_that_is_truncated_beyond_the_limit_raises(self, tmp_path):
        with pytest.raises(OSError, match="File too large"):
            fill(tmp_path / "a", 10, lambda file: file.truncate(11), postpone_errors=True)

    def test_the_end_of_a_file_is_read_as_zeros(self, tmp_path):
        with open_output(tmp_path / "a", postpone_errors=True) as file:
            file.write(b"abc")
            file.seek(1)
            buffer = bytearray(b"xxxx")
            assert file.readinto(buffer) == 2
            assert buffer == b"bc\0\0"


@pytest.mark.parametrize(
    ("text", "number", "words"),
    [
        ("Cannot write. No space left on device.", errno.ENOSPC, "No space left on device"),
        ("[mp4] Disk quota exceeded\nNothing was written", errno.EDQUOT, "Disk quota exceeded"),
        ("ended with status 1\nno such codec\n", errno.EIO, "no such codec"),
    ],
)
def test_the_reason_is_found_in_the_text_of_a_library(tmp_path, text, number, words):
    error = described_error(text, tmp_path / "a")
    assert (error.errno, error.strerror, error.filename) == (number, words, str(tmp_path / "a"))
