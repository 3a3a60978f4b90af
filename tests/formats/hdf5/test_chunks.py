"""Chunks that jotlight compresses itself, which the HDF5 library must read."""

import io
import math

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.hdf5 import captures
from jotlight.formats.hdf5.chunks import fletcher32

h5py = pytest.importorskip("h5py")


@pytest.mark.parametrize("size", [1, 2, 719, 720, 721, 99_999])
@pytest.mark.parametrize("kind", ["random", "zeros", "ones"])
def test_the_checksum_is_that_of_the_library(size, kind):
    data = np.random.default_rng(size).integers(0, 256, size, np.uint8)
    data = {"random": data, "zeros": 0 * data, "ones": np.full_like(data, 255)}[kind]
    with h5py.File(io.BytesIO(), "w") as file:
        stored = file.create_dataset("x", data=data, chunks=data.shape, fletcher32=True)
        _, chunk = stored.id.read_direct_chunk((0,))
    assert chunk[:-4] == data.tobytes()
    assert int.from_bytes(chunk[-4:], "little") == fletcher32(data.tobytes())


@pytest.mark.parametrize("channels", [(), (3,)])
@pytest.mark.parametrize("frames", [1, 4, 5, 70])
def test_other_software_reads_the_chunks(tmp_path, monkeypatch, frames, channels):
    frame_bytes = 6 * 2 * math.prod(channels)
    monkeypatch.setattr(captures, "_WRITTEN_CHUNK_BYTES", 4 * frame_bytes + 1)
    rng = np.random.default_rng(0)
    bits = jl.Bits.from_array(rng.random((frames, 6, 13, *channels)) < 0.3)
    jl.save(bits, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        cube = file["bits"]
        assert (cube.compression, cube.fletcher32) == ("gzip", True)
        assert cube.chunks[0] == min(4, frames)
        assert cube.id.get_num_chunks() == -(-frames // 4)
        np.testing.assert_array_equal(cube[:], bits.packed)


def test_the_library_finds_a_damaged_chunk(tmp_path):
    jl.save(
        jl.Bits.from_array(np.random.default_rng(0).random((9, 6, 13)) < 0.3), tmp_path / "a.h5"
    )
    with h5py.File(tmp_path / "a.h5") as file:
        place = file["bits"].id.get_chunk_info(0).byte_offset
    content = bytearray((tmp_path / "a.h5").read_bytes())
    content[place + 20] ^= 1
    (tmp_path / "a.h5").write_bytes(content)
    with (
        h5py.File(tmp_path / "a.h5") as file,
        pytest.raises(OSError, match="filter returned failure"),
    ):
        file["bits"][:]
