"""Checks of the compressed variables of a `.mat` file."""

import io
import struct
import zlib

import numpy as np
import pytest
from scipy.io import savemat

import jotlight as jl
from jotlight.formats.files import limits
from jotlight.formats.matlab.sizes import check_streams

HEADER = 128


def mat_bytes():
    """Return a `.mat` with two compressed variables."""
    file = io.BytesIO()
    frames = np.random.default_rng(0).integers(0, 2, (5, 7, 9), np.uint8)
    savemat(file, {"OUTPUT": frames, "z": np.arange(9)}, do_compression=True)
    return file.getvalue()


CONTENT = mat_bytes()
END = HEADER + 8 + int.from_bytes(CONTENT[HEADER + 4 : HEADER + 8], "little")
"""Where the first variable ends."""
STREAM = CONTENT[HEADER + 8 : END]
MATRIX = zlib.decompress(STREAM)


def with_stream(stream):
    """Return a `.mat` with this compressed variable."""
    return CONTENT[: HEADER + 4] + len(stream).to_bytes(4, "little") + stream


def is_valid(stream):
    """Return whether zlib accepts a stream, and its length is the one that it states."""
    try:
        matrix = zlib.decompress(stream)
    except zlib.error:
        return False
    return len(matrix) == 8 + int.from_bytes(matrix[4:8], "little")


@pytest.mark.slow
def test_flips_in_a_stream_are_refused_if_its_checksum_detects_them(tmp_path):
    path, refused, bits = tmp_path / "a.mat", 0, range(0, 8 * len(STREAM), 7)
    for bit in bits:
        flipped = bytearray(STREAM)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(with_stream(flipped))
        if is_valid(flipped):  # Adler-32 is weak for few bytes of 0 and 1
            check_streams(io.BytesIO(path.read_bytes()))
        else:
            with pytest.raises((ValueError, zlib.error)):
                check_streams(io.BytesIO(path.read_bytes()))
            refused += 1
    assert refused >= 0.98 * len(bits)


@pytest.mark.parametrize(
    "stream",
    [
        *(STREAM[:-1], STREAM[:-4], STREAM + b"\0", STREAM[:-4] + bytes(4)),
        *(zlib.compress(MATRIX[:-1]), zlib.compress(MATRIX + b"\0"), zlib.compress(b"")),
        zlib.compress(MATRIX + bytes(10**6)),
    ],
)
def test_a_stream_of_another_length_or_checksum_is_refused(tmp_path, stream):
    path = tmp_path / "a.mat"
    path.write_bytes(with_stream(STREAM))
    check_streams(io.BytesIO(path.read_bytes()))
    path.write_bytes(with_stream(stream))
    with pytest.raises((ValueError, zlib.error)):
        check_streams(io.BytesIO(path.read_bytes()))
    with pytest.raises(ValueError, match=r"a\.mat"):
        jl.open(path).to_array()


def test_a_damaged_variable_is_refused_also_if_another_one_is_read(tmp_path):
    path = tmp_path / "a.mat"
    path.write_bytes(CONTENT)
    assert jl.open(path).shape == (9, 5, 7)
    path.write_bytes(CONTENT[:-1] + bytes([CONTENT[-1] ^ 1]))
    with pytest.raises(ValueError, match=r"a\.mat"):
        jl.open(path).to_array()


def variable_of_zeros(height, width, frames, name=b"OUTPUT"):
    """Return a compressed variable of zeros, without the memory that it takes when it is read."""
    size = height * width * frames
    parts = struct.pack("<4I", 6, 8, 9, 0) + struct.pack("<6I", 5, 12, height, width, frames, 0)
    parts += struct.pack("<2I8s", 1, len(name), name) + struct.pack("<2I", 2, size)
    stream = zlib.compressobj(9)
    content = stream.compress(struct.pack("<2I", 14, len(parts) + size) + parts)
    for start in range(0, size, 1 << 20):
        content += stream.compress(bytes(min(1 << 20, size - start)))
    content += stream.flush()
    return struct.pack("<2I", 15, len(content)) + content


def test_a_variable_of_zeros_is_read(tmp_path):
    path = tmp_path / "a.mat"
    path.write_bytes(CONTENT[:HEADER] + variable_of_zeros(40, 50, 20))
    assert jl.open(path).shape == (20, 40, 50)
    assert not jl.open(path).to_array().any()


@pytest.mark.parametrize(
    ("shape", "message"),
    [((1000, 1000, 2), "expected frames of at most"), ((100, 100, 400), "read as a whole")],
)
def test_a_small_file_of_a_large_variable_is_refused(tmp_path, monkeypatch, shape, message):
    monkeypatch.setattr(limits, "_FREE_FRAME_BYTES", 1 << 19)
    monkeypatch.setattr(limits, "_FREE_WHOLE_BYTES", 1 << 21)
    path = tmp_path / "a.mat"
    large, small = variable_of_zeros(*shape), variable_of_zeros(2, 3, 4)
    for content in (large, large + small):  # SciPy reads the first of two equal names
        path.write_bytes(CONTENT[:HEADER] + content)
        with pytest.raises(ValueError, match=rf"a\.mat: .*{message}"):
            jl.open(path)
    path.write_bytes(CONTENT[:HEADER] + small + large)
    assert jl.open(path).shape == (4, 2, 3)
