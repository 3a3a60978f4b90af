"""Compressed cubes, `.npy.gz`."""

import contextlib
import gzip
import io
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from examples.encodings import gzip_bytes, npy_bytes
from jotlight.formats.npy import compressed
from jotlight.formats.verification import verify_capture
from reference import formats as twin

CUBE = npy_bytes(np.zeros((4, 8, 2), np.uint8))


@pytest.mark.parametrize("shape", [(9, 5, 13), (4, 5, 16, 3)])
def test_a_compressed_cube_is_read_in_any_order(tmp_path, shape):
    array = random_frames(shape)
    (tmp_path / "cube.npy.gz").write_bytes(gzip.compress(npy_bytes(twin.packed(array))))
    bits = jl.open(tmp_path / "cube.npy.gz", width=shape[2])
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits[2:4].to_array(), array[2:4])
    np.testing.assert_array_equal(bits[1:].counts(1), array[1:].sum(0))
    assert bits.provenance.format == "npy.gz"


def test_reading_backward_for_long_causes_one_warning(tmp_path, monkeypatch):
    monkeypatch.setattr(compressed, "_MAX_REPEATED_BYTES", 100)
    jl.save(jl.Bits.from_array(random_frames((400, 5, 13))), tmp_path / "cube.npy.gz")
    bits = jl.open(tmp_path / "cube.npy.gz")
    for _ in range(4):  # from front to back
        bits.counts(1)
    bits[300:].counts(1)

    def read_backward():
        for start in range(390, 0, -10):
            bits[start : start + 10].counts(1)

    with pytest.warns(jl.JotlightWarning, match=r"cube\.npy\.gz: is decompressed from") as found:
        read_backward()
    assert len(found) == 1


def test_a_cube_that_another_program_compressed_keeps_its_description(tmp_path):
    array = random_frames((3, 4, 10))
    jl.save(jl.Bits.from_array(array, jl.Sensor(frames=3)), tmp_path / "cube.npy")
    content = (tmp_path / "cube.npy").read_bytes()
    (tmp_path / "cube.npy").unlink()
    (tmp_path / "cube.npy.gz").write_bytes(gzip.compress(content))
    bits = jl.open(tmp_path / "cube.npy.gz")
    assert (bits.shape, bits.sensor) == ((3, 4, 10), jl.Sensor(frames=3))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (gzip_bytes(CUBE)[:-20], "damaged or truncated"),
        (gzip_bytes(CUBE) + b"junk", "it ends too early, or has other bytes after its end"),
        (gzip_bytes(CUBE[:-1]), "ends 1 bytes too early"),
        (gzip_bytes(b"text"), "does not begin like one"),
        (gzip_bytes(npy_bytes(np.zeros((4, 8, 2), np.uint8, order="F"))), "Fortran"),
        (b"\x1f\x8b\x08\x00rubbish", "damaged"),
        (b"\x1f\x8b", "damaged"),
        (
            gzip_bytes(CUBE.replace(b"(4, 8, 2), }            ", b"(4000000000000, 8, 2), }")),
            "more than a file of",
        ),
    ],
    ids=["cut", "followed", "short", "text", "fortran", "rubbish", "header", "huge"],
)  # fmt: skip
def test_damaged_compressed_cubes_are_refused(tmp_path, content, message):
    (tmp_path / "cube.npy.gz").write_bytes(content)
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "cube.npy.gz").to_array()


FRAMES = random_frames((3, 256, 512))
PACKED = twin.packed(FRAMES[:, :5, :13])


def zip_bytes(array):
    file = io.BytesIO()
    np.savez_compressed(file, array)
    return file.getvalue()


STREAMS = {
    "a.npy.gz": gzip_bytes(npy_bytes(PACKED)),
    "a.npz": zip_bytes(FRAMES[:, :5, :13]),
    "b.npz": zip_bytes(np.asfortranarray(FRAMES[:, :5, :13])),
}


def read_one_frame(path):
    return jl.open(path, frames=slice(1, 2)).counts(1)


@pytest.mark.slow
@pytest.mark.parametrize("name", STREAMS)
def test_no_flipped_bit_of_a_foreign_stream_changes_what_is_read(tmp_path, name):
    content, expected = STREAMS[name], None
    results = []
    for bit in [None, *range(0, 8 * len(content), 13)]:
        damaged = bytearray(content)
        if bit is not None:
            damaged[bit // 8] ^= 1 << bit % 8
        (tmp_path / name).write_bytes(damaged)
        with contextlib.suppress(ValueError, OSError):
            results.append(read_one_frame(tmp_path / name))
            expected = results[0] if expected is None else expected
            np.testing.assert_array_equal(results[-1], expected)
    assert 1 <= len(results) < len(content)


@pytest.mark.parametrize("name", ["a.npy.gz", "a.bin.gz"])
@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:-1],
        lambda content: content[:-8],
        lambda content: content[:-8] + bytes(8),
        lambda content: content[:-4] + b"\1" + content[-3:],
        lambda content: content + b"more",
        lambda content: content + content[:20],
    ],
    ids=["cut by 1", "no trailer", "wrong CRC", "wrong length", "garbage", "half a member"],
)
def test_the_end_is_checked_before_the_first_frame_is_returned(tmp_path, name, damage):
    if name == "a.npy.gz":
        # Without this option, the frames at the end are inspected, which compares the CRC too.
        # The file is longer than a buffer, which would reach the end when the header is read.
        content, options = gzip_bytes(npy_bytes(twin.packed(FRAMES))), {"unpacked": False}
    else:
        content, options = gzip_bytes(twin.encode_half_array(FRAMES)), {"format": "swissspad2"}
    path = tmp_path / name
    path.write_bytes(content)
    assert len(jl.open(path, frames=slice(0, 1), **options)) == 1
    path.write_bytes(damage(content))
    with pytest.raises(ValueError, match=r"\.gz: damaged or truncated"):
        jl.open(path, frames=slice(0, 1), **options)


@pytest.mark.slow
def test_a_stream_that_continues_after_its_array_is_read_to_one_byte_more(tmp_path, monkeypatch):
    content = npy_bytes(PACKED)
    endless = compressed.igzip.compress(content + bytes(1 << 26))
    (tmp_path / "a.npy.gz").write_bytes(endless)
    largest = 0

    class Counting(compressed.igzip.IGzipFile):
        def read(self, size=-1):
            nonlocal largest
            data = super().read(size)
            largest = max(largest, self.tell())
            return data

    monkeypatch.setattr(compressed.igzip, "IGzipFile", Counting)
    with pytest.raises(ValueError, match="more bytes follow than the header"):
        jl.open(tmp_path / "a.npy.gz")
    assert largest == len(content) + 1


def test_members_of_a_gzip_file_are_joined(tmp_path):
    content = npy_bytes(PACKED)
    joined = gzip_bytes(content[:100]) + gzip_bytes(content[100:])
    (tmp_path / "a.npy.gz").write_bytes(joined)
    np.testing.assert_array_equal(np.asarray(jl.open(tmp_path / "a.npy.gz").packed), PACKED)


def test_a_copy_that_another_program_compressed_is_compared_with_the_original(tmp_path):
    jl.save(jl.Bits.from_array(FRAMES[:, :5, :13]), tmp_path / "a.npy")
    content = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").unlink()
    (tmp_path / "a.npy.gz").write_bytes(gzip.compress(content))
    assert verify_capture(tmp_path / "a.npy.gz").startswith("2 files match")
    (tmp_path / "a.npy.gz").write_bytes(gzip.compress(content[:-1] + b"\1"))
    with pytest.raises(ValueError, match=r"a\.npy\.gz: is damaged or was changed"):
        jl.open(tmp_path / "a.npy.gz")


@pytest.fixture
def long_stream(tmp_path):
    """A compressed capture that is longer than the buffer of its reader, and its frames."""
    packed = np.random.default_rng(0).integers(0, 256, (8, 512, 512), np.uint8)
    (tmp_path / "a.npy.gz").write_bytes(gzip_bytes(npy_bytes(packed)))
    return jl.open(tmp_path / "a.npy.gz").packed, packed


def test_threads_read_one_stream_independently(long_stream):
    frames, expected = long_stream
    order = [0, 5, 1, 7, 2] * 4
    with ThreadPoolExecutor(4) as threads:
        read = threads.map(lambda frame: frames.read(frame, frame + 1), order)
        for frame, part in zip(order, read, strict=True):
            np.testing.assert_array_equal(part[0], expected[frame])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_does_not_disturb_the_stream(long_stream):
    frames, expected = long_stream
    frames.read(0, 1)
    child = os.fork()
    if child == 0:
        correct = np.array_equal(frames.read(1, 7), expected[1:7])
        os._exit(0 if correct else 1)
    assert os.waitpid(child, 0)[1] == 0
    np.testing.assert_array_equal(frames.read(1, 7), expected[1:7])


@pytest.mark.parametrize("name", ["a.npy.gz", "a.npz"])
def test_a_file_that_changes_after_it_was_opened_is_not_read(tmp_path, name):
    (tmp_path / name).write_bytes(STREAMS[name])
    frames = jl.open(tmp_path / name).packed
    frames.read(0, 1)
    other = zip_bytes(~FRAMES[:, :5, :13]) if name == "a.npz" else gzip_bytes(npy_bytes(~PACKED))
    (tmp_path / name).write_bytes(other)
    with pytest.raises((OSError, ValueError), match=r"changed since it was opened|damaged"):
        frames.read(0, 1)
