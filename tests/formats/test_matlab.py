"""MATLAB files: parts, variables, and version 7.3."""

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames

COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


def test_parts_are_read_in_natural_order(tmp_path):
    from scipy.io import savemat

    array = random_frames((23, 5, 7))
    for number, part in enumerate(np.array_split(array, 11)):
        name = tmp_path / f"part_{number + 1}.mat"
        savemat(name, {"OUTPUT": np.moveaxis(part, 0, 2).astype([np.uint8, float][number % 2])})
    bits = jl.open(tmp_path)
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits.counts(), array.sum(0))
    (tmp_path / "info.json").write_text('{"no_parts": 11, "no_frames": 20}')
    assert len(jl.open(tmp_path)) == 20
    (tmp_path / "info.json").write_text('{"no_parts": 12, "no_frames": 23}')
    with pytest.warns(jl.JotlightWarning, match="states 12 parts, but there are 11"):
        assert len(jl.open(tmp_path)) == 23


def test_variables_are_chosen_by_name(tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"x": COUNTS[0], "text": "words", "y": np.ones((2, 3), bool)})
    np.testing.assert_array_equal(jl.open(tmp_path / "a.mat", key="x", counts=True), COUNTS[0])
    assert jl.open(tmp_path / "a.mat", key="y").shape == (1, 2, 3)
    with pytest.raises(ValueError, match=r"--key\): x, y"):
        jl.open(tmp_path / "a.mat")
    with pytest.raises(ValueError, match="0 and 1 only"):
        jl.open(tmp_path / "a.mat", key="x").counts()
    (tmp_path / "a.mat").write_bytes((tmp_path / "a.mat").read_bytes()[:150])
    with pytest.raises(ValueError, match=r"a\.mat"):
        jl.open(tmp_path / "a.mat", key="x").counts()


def test_version_7_3_is_hdf5_with_reversed_dimensions(tmp_path):
    h5py = pytest.importorskip("h5py")
    array = random_frames((4, 5, 7))
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file["OUTPUT"] = array.swapaxes(1, 2).astype(np.uint8)
    with (tmp_path / "a.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    np.testing.assert_array_equal(jl.open(tmp_path / "a.mat").to_array(), array)
