"""Compressed cubes, `.npy.gz`."""

import gzip

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from examples.encodings import gzip_bytes, npy_bytes
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
        (gzip_bytes(CUBE)[:-20], "damaged or truncated|ends before"),
        (gzip_bytes(CUBE[:-1]), "ends before the 4 frames"),
        (gzip_bytes(b"text"), "does not begin like one"),
        (gzip_bytes(npy_bytes(np.zeros((4, 8, 2), np.uint8, order="F"))), "Fortran"),
        (b"\x1f\x8b\x08\x00rubbish", "damaged"),
        (b"\x1f\x8b", "damaged"),
        (
            gzip_bytes(CUBE.replace(b"(4, 8, 2), }            ", b"(4000000000000, 8, 2), }")),
            "more than a file of",
        ),
    ],
    ids=["cut", "short", "text", "fortran", "rubbish", "header", "huge"],
)  # fmt: skip
def test_damaged_compressed_cubes_are_refused(tmp_path, content, message):
    (tmp_path / "cube.npy.gz").write_bytes(content)
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "cube.npy.gz").to_array()
