"""zarr folders: arrays and codecs."""

import contextlib
import json
import os
import shutil

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames

COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


def test_arrays_are_chosen_by_name(tmp_path):
    zarr = pytest.importorskip("zarr")
    array = random_frames((4, 5, 16))
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w")
    for name, values in {"counts": COUNTS, "bool": array, "exposure": np.array(0.5)}.items():
        group.create_array(name, shape=values.shape, dtype=values.dtype)[...] = values
    counts = jl.open(tmp_path / "a.zarr", key="/counts", frames=slice(0, 3))
    np.testing.assert_array_equal(counts, COUNTS[:3].sum(0))
    np.testing.assert_array_equal(jl.open(tmp_path / "a.zarr", key="bool").to_array(), array)
    with pytest.raises(ValueError, match=r"--key.*bool, counts, exposure"):
        jl.open(tmp_path / "a.zarr")


@pytest.mark.parametrize("zarr_format", [2, 3])
def test_unknown_codecs_are_refused(tmp_path, zarr_format):
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "a.zarr"
    zarr.open_array(str(path), mode="w", shape=(2, 3), dtype="i4", zarr_format=zarr_format)
    description = path / ("zarr.json" if zarr_format == 3 else ".zarray")
    metadata = json.loads(description.read_text())
    if zarr_format == 3:
        metadata["codecs"].append({"name": "numcodecs.pickle", "configuration": {}})
    else:
        metadata["filters"] = [{"id": "pickle", "protocol": 5}]
    description.write_text(json.dumps(metadata))
    with pytest.raises(ValueError, match="known safe codecs"):
        jl.open(path)


def count_chunks(folder):
    return sum(path.is_file() and path.name[0] not in ".z" for path in folder.rglob("*"))


@pytest.mark.parametrize(
    "options",
    [
        {"zarr_format": 2},
        {"zarr_format": 2, "chunk_key_encoding": {"name": "v2", "separator": "/"}},
        {"zarr_format": 3},
        {"zarr_format": 3, "chunk_key_encoding": {"name": "default", "separator": "."}},
        {"zarr_format": 3, "chunk_key_encoding": {"name": "v2", "separator": "."}},
        {"zarr_format": 3, "chunk_key_encoding": {"name": "v2", "separator": "/"}},
        {"zarr_format": 3, "shards": (4, 6, 4)},
    ],
)
def test_missing_chunks_are_the_fill_value_and_are_reported_once(tmp_path, options):
    zarr = pytest.importorskip("zarr")
    array = zarr.create_array(
        str(tmp_path / "a.zarr"), shape=(5, 6, 7), chunks=(2, 3, 4), dtype="u2", fill_value=7,
        **options,
    )  # fmt: skip
    expected = np.full((5, 6, 7), 7)
    array[:3, :, :4] = expected[:3, :, :4] = COUNTS[:3, :, :4]
    kind, total = ("shards", 4) if "shards" in options else ("chunks", 12)
    stored = count_chunks(tmp_path / "a.zarr")
    message = rf"a\.zarr: {total - stored} of its {total} {kind} are missing and are read as 7"
    with pytest.warns(jl.JotlightWarning, match=message) as warnings:
        counts = jl.open(tmp_path / "a.zarr", frames=slice(0, 5))
    assert len(warnings) == 1
    np.testing.assert_array_equal(counts, expected.sum(0))
    array[...] = COUNTS
    jl.open(tmp_path / "a.zarr", frames=slice(0, 5))


@pytest.mark.parametrize("written", [10, 300])
def test_empty_and_dark_chunks_may_be_of_any_number(tmp_path, written):
    # An array that was allocated before the capture, and one of few dark counts.
    zarr = pytest.importorskip("zarr")
    shape, chunks = (300, 256, 256), (10, 256, 256)
    array = zarr.create_array(str(tmp_path / "a.zarr"), shape=shape, chunks=chunks, dtype=bool)
    expected = np.zeros((written, 256, 256), bool)
    expected[::10, 3, 4] = True
    array[:written] = expected
    missing = pytest.warns(jl.JotlightWarning, match="29 of its 30 chunks are missing")
    with missing if written == 10 else contextlib.nullcontext():
        bits = jl.open(tmp_path / "a.zarr")
    np.testing.assert_array_equal(bits[:20].counts(), expected[:20].sum(0))


def test_an_array_whose_chunks_are_nearly_all_missing_is_refused(tmp_path):
    zarr = pytest.importorskip("zarr")
    zarr.create_array(str(tmp_path / "a.zarr"), shape=(10**5, 8, 8), chunks=(1, 8, 8), dtype=bool)
    with pytest.raises(ValueError, match=r"only 0 of its 100000 chunks exist.*resize the array"):
        jl.open(tmp_path / "a.zarr")


def test_a_color_image_that_claims_too_many_rows_is_refused_before_it_is_read(tmp_path):
    zarr = pytest.importorskip("zarr")
    shape, chunks = (10**7, 64, 3), (2000, 64, 3)
    zarr.create_array(str(tmp_path / "a.zarr"), shape=shape, chunks=chunks, dtype="u1")
    with (
        pytest.warns(jl.JotlightWarning, match="5000 of its 5000 chunks are missing"),
        pytest.raises(ValueError, match=r"expected frames of at most .*, got 1920000000;"),
    ):
        jl.open(tmp_path / "a.zarr")


def test_only_the_array_that_is_read_is_reported(tmp_path):
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w")
    group.create_array("counts", shape=COUNTS.shape, dtype="u2")[...] = COUNTS
    group.create_array("empty", shape=COUNTS.shape, dtype="u2")
    jl.open(tmp_path / "a.zarr", key="counts", frames=slice(0, 1))
    with pytest.warns(jl.JotlightWarning, match="empty: 1 of its 1 chunks are missing"):
        jl.open(tmp_path / "a.zarr", key="empty", frames=slice(0, 1))


def delete(folder):
    (folder / "c/1/0/0").unlink()


def replace(folder):
    (folder / "c/0/0/0").replace(folder / "c/1/0/0")


def add(folder):
    (folder / "c/2/0").mkdir(parents=True)
    shutil.copy(folder / "c/0/0/0", folder / "c/2/0/0")


def rewrite(folder):
    content = (folder / "c/0/0/0").read_bytes()
    (folder / "c/1/0/0").write_bytes(content)
    os.utime(folder / "c/1/0/0", (1, 1))


@pytest.mark.parametrize("change", [delete, replace, add, rewrite])
def test_chunks_that_change_after_opening_are_errors(tmp_path, change):
    array = random_frames((6, 5, 16))
    array[4:] = 0  # zarr omits this chunk
    zarr = pytest.importorskip("zarr")
    path = str(tmp_path / "a.zarr")
    stored = zarr.create_array(path, shape=array.shape, chunks=(2, 5, 16), dtype=array.dtype)
    stored[...] = array
    with pytest.warns(jl.JotlightWarning, match="1 of its 3 chunks are missing"):
        bits = jl.open(path)
    np.testing.assert_array_equal(bits.to_array(), array)
    change(tmp_path / "a.zarr")
    for read in (bits.to_array, lambda: jl.save(bits, tmp_path / "copy.npy")):
        with pytest.raises(OSError, match=r"c/[012]/0/0") as caught:
            read()
        assert "damaged" not in str(caught.value)


def test_an_empty_shard_is_an_error(tmp_path):
    zarr = pytest.importorskip("zarr")
    array = random_frames((12, 8, 8))
    path = tmp_path / "a.zarr"
    shapes = {"chunks": (2, 8, 8), "shards": (4, 8, 8)}
    zarr.create_array(str(path), shape=array.shape, dtype=array.dtype, **shapes)[...] = array
    (path / "c/1/0/0").write_bytes(b"")
    with pytest.raises(ValueError, match="c/1/0/0 has 0 bytes"):
        jl.open(path).to_array()


@pytest.mark.parametrize("name", ["pad", "c/9/9/9", "0.0.0", "c/0/0/00"])
def test_files_that_are_no_chunks_do_not_raise_the_limit_of_sizes(tmp_path, name):
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "a.zarr"
    array = zarr.create_array(str(path), shape=(2, 9000, 9000), chunks=(1, 900, 900), dtype="u1")
    array[0, :900, :900] = 1
    (path / name).parent.mkdir(parents=True, exist_ok=True)
    (path / name).touch()
    os.truncate(path / name, 1 << 24)
    with pytest.raises(ValueError, match=r"expected frames of at most .*, got 81000000;"):
        jl.open(path)


@pytest.mark.parametrize("shards", [None, (10, 8, 8)])
def test_each_chunk_is_decoded_once_when_frames_are_read_in_order(tmp_path, shards, monkeypatch):
    zarr = pytest.importorskip("zarr")
    from jotlight.formats.zarr import codecs

    array = random_frames((12, 8, 8))
    path = str(tmp_path / "a.zarr")
    shapes = {"chunks": (5, 8, 8), "shards": shards}
    zarr.create_array(path, shape=array.shape, dtype=array.dtype, **shapes)[...] = array
    decode, sizes = codecs.decode_exactly, []
    monkeypatch.setattr(
        codecs, "decode_exactly", lambda *given: (sizes.append(given[2]), decode(*given))[1]
    )
    packed = jl.open(path).packed
    for start in range(12):
        part = np.unpackbits(packed.read(start, start + 1), axis=2)
        np.testing.assert_array_equal(part[0], array[start])
    assert sizes == [5 * 8 * 8] * 3
