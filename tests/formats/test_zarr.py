"""zarr folders: arrays and codecs."""

import json

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames

COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


def test_arrays_are_chosen_by_name(tmp_path):
    zarr = pytest.importorskip("zarr")
    array = random_frames((4, 5, 16))
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w")
    for name, values in {"counts": COUNTS, "bool": array}.items():
        group.create_array(name, shape=values.shape, dtype=values.dtype)[...] = values
    counts = jl.open(tmp_path / "a.zarr", key="counts", frames=slice(0, 3))
    np.testing.assert_array_equal(counts, COUNTS[:3].sum(0))
    np.testing.assert_array_equal(jl.open(tmp_path / "a.zarr", key="bool").to_array(), array)
    with pytest.raises(ValueError, match=r"--key.*bool, counts"):
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
