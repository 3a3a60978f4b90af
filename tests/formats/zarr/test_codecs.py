"""Decompression in zarr folders: chunks of the right size only, in little memory."""

import bz2
import json
import lzma
import struct
import tracemalloc
import zlib

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.zarr import captures as module

pytestmark = pytest.mark.slow

zarr = pytest.importorskip("zarr")
numcodecs = pytest.importorskip("numcodecs")

SHAPE = (600, 1000)
COUNTS = np.random.default_rng(0).integers(0, 200, SHAPE, np.uint8)
BOMB_BYTES = 1 << 26


def inflating(compressor):
    """Return a stream that decompresses to BOMB_BYTES zeros."""
    block = bytes(1 << 24)
    parts = [compressor.compress(block) for _ in range(BOMB_BYTES // len(block))]
    return b"".join([*parts, compressor.flush()])


def zstd_frame(stated):
    """Return a zstd frame of repeated bytes, with or without a statement of its size."""
    window = bytes([(17 - 10) << 3])
    header = bytes([0xC0]) + window + BOMB_BYTES.to_bytes(8, "little") if stated else b"\0" + window
    number = BOMB_BYTES // (1 << 17)
    blocks = [(1 << 17 << 3 | 2 | (n == number - 1)).to_bytes(3, "little") for n in range(number)]
    return b"\x28\xb5\x2f\xfd" + header + b"".join(block + b"\0" for block in blocks)


BOMBS = {
    "zlib": lambda: inflating(zlib.compressobj(1)),
    "gzip": lambda: inflating(zlib.compressobj(1, wbits=31)),
    "bz2": lambda: inflating(bz2.BZ2Compressor(1)),
    "lzma": lambda: inflating(lzma.LZMACompressor(preset=0)),
    "zstd": lambda: zstd_frame(stated=True),
    "zstd of unknown size": lambda: zstd_frame(stated=False),
    "blosc": lambda: bytes([2, 1, 0x81, 1]) + struct.pack("<III", BOMB_BYTES, 1 << 20, 999),
    "lz4": lambda: struct.pack("<I", BOMB_BYTES) + bytes(999),
}


def version_2(path, chunk, compressor, filters=None):
    path.mkdir()
    metadata = {"zarr_format": 2, "shape": SHAPE, "chunks": SHAPE, "dtype": "|u1", "order": "C"}
    codecs = {"compressor": compressor, "filters": filters, "fill_value": 0}
    (path / ".zarray").write_text(json.dumps({**metadata, **codecs}))
    (path / "0.0").write_bytes(chunk)


def version_3(path, chunk, codecs):
    array = zarr.create_array(str(path), shape=SHAPE, chunks=SHAPE, dtype="u1")
    array[...] = 1
    metadata = json.loads((path / "zarr.json").read_text())
    (path / "zarr.json").write_text(json.dumps({**metadata, "codecs": codecs}))
    (path / "c/0/0").write_bytes(chunk)


def shard_of(chunk):
    index = struct.pack("<QQ", 0, len(chunk))
    checksum = numcodecs.checksum32.crc32c_checksum(index, 0)
    return chunk + index + struct.pack("<I", checksum)


LITTLE = {"name": "bytes", "configuration": {"endian": "little"}}
CODECS = {
    "gzip": {"name": "gzip", "configuration": {"level": 1}},
    "zstd": {"name": "zstd", "configuration": {"level": 0, "checksum": False}},
    "blosc": {
        "name": "blosc",
        "configuration": {
            "cname": "zstd",
            "clevel": 5,
            "shuffle": "noshuffle",
            "typesize": 1,
            "blocksize": 0,
        },
    },
}


def sharded(codec, index_codecs=(LITTLE, {"name": "crc32c"})):
    configuration = {
        "chunk_shape": SHAPE,
        "codecs": [{"name": "bytes"}, codec],
        "index_location": "end",
        "index_codecs": index_codecs,
    }
    return [{"name": "sharding_indexed", "configuration": configuration}]


def assert_refused_in_little_memory(path, match="a chunk is damaged"):
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=match):
            jl.open(path)
        assert tracemalloc.get_traced_memory()[1] < 24 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", BOMBS)
def test_a_chunk_that_inflates_is_refused_before_memory_is_taken(name, tmp_path):
    codec, bomb = name.split()[0], BOMBS[name]()
    version_2(tmp_path / "v2", bomb, numcodecs.get_codec({"id": codec}).get_config())
    assert_refused_in_little_memory(tmp_path / "v2")
    if codec in CODECS:
        version_3(tmp_path / "v3", bomb, [{"name": "bytes"}, CODECS[codec]])
        assert_refused_in_little_memory(tmp_path / "v3")
        version_3(tmp_path / "shard", shard_of(bomb), sharded(CODECS[codec]))
        assert_refused_in_little_memory(tmp_path / "shard")


@pytest.mark.parametrize("size", [0, 599_999, 600_001])
@pytest.mark.parametrize("codec", ["zlib", "gzip", "bz2", "lzma", "zstd", "blosc", "lz4"])
def test_a_chunk_of_another_size_is_refused(codec, size, tmp_path):
    encoder = numcodecs.get_codec({"id": codec})
    encoded = encoder.encode(np.zeros(size, np.uint8))
    version_2(tmp_path / "a", bytes(encoded), encoder.get_config())
    assert_refused_in_little_memory(tmp_path / "a")


@pytest.mark.parametrize("codec", ["zlib", "gzip", "bz2", "lzma", "zstd", "blosc", "lz4"])
def test_a_truncated_chunk_is_refused(codec, tmp_path):
    encoder = numcodecs.get_codec({"id": codec})
    encoded = bytes(encoder.encode(COUNTS))
    for number, kept in enumerate((encoded[:-1], encoded[:9], b"")):
        version_2(tmp_path / str(number), kept, encoder.get_config())
        assert_refused_in_little_memory(tmp_path / str(number))


def test_compressors_inside_each_other_are_refused(tmp_path):
    chunk = zlib.compress(zlib.compress(bytes(600_000)))
    version_2(tmp_path / "v2", chunk, {"id": "zlib", "level": 1}, [{"id": "zlib", "level": 1}])
    version_3(tmp_path / "v3", chunk, [{"name": "bytes"}, CODECS["gzip"], CODECS["gzip"]])
    for name in ("v2", "v3"):
        assert_refused_in_little_memory(tmp_path / name, "only checksums after a compressor")


def test_files_of_chunks_that_are_too_long_are_not_read(tmp_path):
    version_2(tmp_path / "v2", b"", None)
    version_3(tmp_path / "v3", b"", [{"name": "bytes"}, CODECS["zstd"]])
    version_3(tmp_path / "shard", b"", sharded(CODECS["zstd"]))
    for name, chunk in {"v2": "0.0", "v3": "c/0/0", "shard": "c/0/0"}.items():
        with (tmp_path / name / chunk).open("r+b") as file:
            file.truncate(1 << 33)
        assert_refused_in_little_memory(tmp_path / name, "has 8589934592 bytes, expected 1 to")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"index_codecs": [LITTLE, CODECS["gzip"]]}, "only bytes and crc32c"),
        ({"chunk_shape": [1, 1]}, "a chunk in it has|a chunk is damaged"),
    ],
)
def test_hostile_shards_are_refused(tmp_path, change, message):
    codecs = sharded(CODECS["zstd"])
    codecs[0]["configuration"].update(change)
    version_3(tmp_path / "a", shard_of(b"\0" * 99), codecs)
    assert_refused_in_little_memory(tmp_path / "a", message)


def test_absurd_numbers_of_chunks_are_refused(tmp_path):
    version_2(tmp_path / "tiny", b"0", None)
    change(tmp_path / "tiny" / ".zarray", chunks=[1, 1])
    assert_refused_in_little_memory(tmp_path / "tiny", "only 1 of its 600000 chunks exist")
    version_2(tmp_path / "huge", b"0", None)
    change(tmp_path / "huge" / ".zarray", chunks=[2**15, 2**15])
    assert_refused_in_little_memory(tmp_path / "huge", "chunks of at most 268435456 bytes")


def change(path, **changes):
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


FILTERS = {
    "none": ([], "u1"),
    "delta": ([numcodecs.Delta("u1", "i2")], "u1"),
    "shuffle": ([numcodecs.Shuffle(2)], "u2"),
    "packbits": ([numcodecs.PackBits()], "?"),
    "crc32": ([numcodecs.CRC32()], "u1"),
    "adler32": ([numcodecs.Adler32()], "u1"),
}


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        *((name, "zstd") for name in FILTERS),
        *(("none", codec) for codec in (None, "zlib", "gzip", "bz2", "lzma", "blosc", "lz4")),
        ("delta", None),
    ],
)
def test_chunks_of_version_2_are_read_with_every_codec(name, codec, tmp_path):
    filters, dtype = FILTERS[name]
    compressor = None if codec is None else numcodecs.get_codec({"id": codec})
    options = {"filters": filters or None, "compressors": compressor, "zarr_format": 2}
    values = COUNTS[:50, :60].astype(dtype)
    array = zarr.create_array(
        str(tmp_path / "a"), shape=values.shape, chunks=(20, 60), dtype=dtype, **options
    )
    array[...] = values
    np.testing.assert_array_equal(jl.open(tmp_path / "a", counts=True), values)


@pytest.mark.parametrize(
    ("codec", "shards", "order"),
    [
        *(("Gzip", None, None), ("Zstd", (40, 60), None), ("Blosc", (40, 60), (1, 0))),
        *(("Blosc", None, None), ("Crc32c", None, (1, 0)), (None, (20, 20), None)),
    ],
)
def test_chunks_of_version_3_are_read_with_every_codec(codec, shards, order, tmp_path):
    compressors = None if codec is None else getattr(zarr.codecs, f"{codec}Codec")()
    filters = None if order is None else zarr.codecs.TransposeCodec(order=order)
    array = zarr.create_array(
        str(tmp_path / "a"), shape=(50, 60), chunks=(20, 20), shards=shards, dtype="u2",
        compressors=compressors, filters=filters,
    )  # fmt: skip
    array[...] = COUNTS[:50, :60]
    np.testing.assert_array_equal(jl.open(tmp_path / "a"), COUNTS[:50, :60])


def test_large_reads_are_split_at_chunks(tmp_path, monkeypatch):
    frames = np.random.default_rng(1).integers(0, 9, (7, 20, 33), np.uint8)
    array = zarr.create_array(str(tmp_path / "a"), shape=frames.shape, chunks=(2, 9, 5), dtype="u1")
    array[...] = frames
    for most in (1, 7):
        monkeypatch.setattr(module, "_MAX_READ_BYTES", most * 90)
        for first, last in ((0, 7), (1, 2), (3, 7)):
            found = jl.open(tmp_path / "a", frames=slice(first, last))
            np.testing.assert_array_equal(found, frames[first:last].sum(0, dtype=np.int32))


def test_a_part_of_a_shard_that_is_too_long_is_not_read(tmp_path):
    array = zarr.create_array(
        str(tmp_path / "a"), shape=(4, 10, 10), chunks=(1, 10, 10), shards=(4, 10, 10), dtype="u1",
        compressors=None,
    )  # fmt: skip
    array[...] = 1
    entries = struct.pack("<8Q", *(number for start in range(4) for number in (start, 300)))
    checksum = struct.pack("<I", numcodecs.checksum32.crc32c_checksum(entries, 0))
    (tmp_path / "a" / "c/0/0/0").write_bytes(bytes(400) + entries + checksum)
    with pytest.raises(ValueError, match="a chunk in it has 300 bytes, more than expected"):
        jl.open(tmp_path / "a", frames=slice(1, 2))
