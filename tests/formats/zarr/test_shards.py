"""Shards of hostile zarr folders take little memory."""

import json

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.files.checksums import file_checksum, seal
from jotlight.formats.verification import verify_capture
from jotlight.formats.zarr.shards import chunks_per_shard, parts_of_shard

pytest.importorskip("zarr")


def with_index(data, places):
    """Return a shard of bytes, whose index states positions and sizes, without a checksum."""
    return data + np.array(places, "<u8").tobytes() + bytes(4)


def test_the_parts_of_a_shard_are_its_chunks_and_its_index():
    shard = with_index(b"firstsecond", [(5, 6), (2**64 - 1, 2**64 - 1), (0, 5)])
    assert parts_of_shard(shard, 3) == [b"first", b"second", shard[11:]]


def test_chunks_that_overlap_are_refused():
    """Otherwise, each of a million chunks could be a copy of a file of megabytes."""
    shard = with_index(bytes(1000), [(0, 1000)] * 50)
    with pytest.raises(ValueError, match="the index of a shard is damaged"):
        parts_of_shard(shard, 50)


def described(shard, inner):
    codec = {"name": "sharding_indexed", "configuration": {"chunk_shape": inner}}
    return {"chunk_grid": {"configuration": {"chunk_shape": shard}}, "codecs": [codec]}


def test_the_number_of_chunks_follows_from_the_metadata(tmp_path):
    path = tmp_path / "zarr.json"
    for content, number in ((described([8, 4, 2], [2, 4, 1]), 8), ({"codecs": []}, 1), ({}, 1)):
        path.write_text(json.dumps(content))
        assert chunks_per_shard(path) == number


@pytest.mark.parametrize(
    "content",
    [
        *([], {"codecs": 1}, {"codecs": [1]}, {"codecs": [{}]}),
        {"codecs": [{"name": "sharding_indexed"}]},
        *(described([4], [0]), described([4], ["a"]), described(4, [2]), described([1e300], [1])),
        # The product of these would be a list of 8 TB.
        described([[0], 10**12], [1]),
    ],
)
def test_damaged_metadata_are_refused_when_a_folder_is_verified(tmp_path, content):
    folder = tmp_path / "a.zarr"
    jl.save(jl.Bits(np.zeros((40, 6, 2), np.uint8)), folder)
    path = folder / "zarr.json"
    path.write_text(json.dumps(content))
    manifest = json.loads((folder / "jotlight.json").read_text())
    del manifest["checksum"]
    manifest["metadata"]["zarr.json"] = file_checksum(path)
    manifest["chunks"] = dict.fromkeys(manifest["chunks"], "0" * 40)
    (folder / "jotlight.json").write_text(seal(manifest))
    with pytest.raises(ValueError, match="is damaged"):
        chunks_per_shard(path)
    with pytest.raises(ValueError, match="is damaged"):
        verify_capture(folder, format="zarr")
