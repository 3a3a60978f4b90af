"""The codec `packbits` of zarr 3. The expected bytes follow the text of its specification."""

import json

import numpy as np
import pytest

import jotlight as jl

zarr = pytest.importorskip("zarr")

SHAPE, CHUNKS = (7, 5, 13), (3, 5, 13)


def write_array(folder, settings, extra=()):
    """Write booleans as the specification states it, without the codec of jotlight."""
    values = np.random.default_rng(0).random(SHAPE) < 0.4
    metadata = {
        "zarr_format": 3,
        "node_type": "array",
        "shape": SHAPE,
        "data_type": "bool",
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": CHUNKS}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": False,
        "codecs": [{"name": "packbits", **settings}, *extra],
        "attributes": {},
    }
    for chunk in range(3):
        part = np.zeros(CHUNKS, bool)
        part[: len(values[3 * chunk : 3 * chunk + 3])] = values[3 * chunk : 3 * chunk + 3]
        number = sum(int(bit) << place for place, bit in enumerate(part.ravel()))
        size = -(-part.size // 8)
        content = number.to_bytes(size, "little")
        padding = bytes([8 * size - part.size])
        where = (settings.get("configuration") or {}).get("padding_encoding")
        content = {"first_byte": padding + content, "last_byte": content + padding}.get(
            where, content
        )
        path = folder / "c" / str(chunk) / "0" / "0"
        path.parent.mkdir(parents=True)
        path.write_bytes(content)
    (folder / "zarr.json").write_text(json.dumps(metadata))
    return values


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"configuration": {}},
        {"configuration": {"padding_encoding": "none"}},
        {"configuration": {"padding_encoding": "first_byte", "first_bit": None}},
        {"configuration": {"padding_encoding": "last_byte", "last_bit": 0}},
    ],
)
def test_booleans_are_read(tmp_path, settings):
    values = write_array(tmp_path, settings)
    np.testing.assert_array_equal(jl.open(tmp_path).to_array(), values)


@pytest.mark.parametrize("padding", ["none", "first_byte", "last_byte"])
@pytest.mark.parametrize("compressor", [[], [zarr.codecs.ZstdCodec(), zarr.codecs.Crc32cCodec()]])
def test_compressed_booleans_are_read(tmp_path, padding, compressor):
    from jotlight.formats.zarr.packbits import PackBits

    values = np.random.default_rng(0).random(SHAPE) < 0.4
    array = zarr.create_array(
        str(tmp_path / "a"),
        shape=SHAPE,
        chunks=CHUNKS,
        dtype=bool,
        serializer=PackBits(padding),
        compressors=compressor,
    )
    array[...] = values
    np.testing.assert_array_equal(jl.open(tmp_path / "a").to_array(), values)


@pytest.mark.parametrize(
    "settings",
    [
        {"configuration": {"padding_encoding": "middle"}},
        {"configuration": {"first_bit": 1}},
        {"configuration": {"last_bit": 3}},
    ],
)
def test_other_settings_are_refused(tmp_path, settings):
    write_array(tmp_path, settings)
    with pytest.raises(ValueError, match="packbits"):
        jl.open(tmp_path)


@pytest.mark.parametrize("content", [b"", b"12", bytes(25), bytes([9]) + bytes(25)])
def test_chunks_of_another_size_or_padding_are_refused(tmp_path, content):
    write_array(tmp_path, {"configuration": {"padding_encoding": "first_byte"}})
    (tmp_path / "c/1/0/0").write_bytes(content)
    with pytest.raises(ValueError, match="a chunk is damaged"):
        jl.open(tmp_path).to_array()
