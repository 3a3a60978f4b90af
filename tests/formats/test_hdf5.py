"""HDF5 files: data sets, labels, and hostile files."""

import sys

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from reference import formats as twin

COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


def test_data_sets_are_chosen_by_name(tmp_path):
    h5py = pytest.importorskip("h5py")
    array = random_frames((4, 5, 16))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a/counts"] = COUNTS
        file["bool"] = array
        file["cube"] = twin.packed(array)
        file["out"] = h5py.ExternalLink("other.h5", "x")
    counts = jl.open(tmp_path / "a.h5", key="a/counts", frames=slice(0, 3))
    np.testing.assert_array_equal(counts, COUNTS[:3].sum(0))
    np.testing.assert_array_equal(jl.open(tmp_path / "a.h5", key="bool").to_array(), array)
    bits = jl.open(tmp_path / "a.h5", key="cube", counts=False, width=15)
    np.testing.assert_array_equal(bits.to_array(), array[..., :15])
    for key in (None, "out", "none"):
        with pytest.raises(ValueError, match=r"--key.*a/counts, bool, cube"):
            jl.open(tmp_path / "a.h5", key=key)


@pytest.mark.parametrize("label", ["{}", 3])
def test_a_label_of_another_type_is_ignored_with_a_warning(tmp_path, label):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = COUNTS[0]
        file["a"].attrs["jotlight"] = label  # h5py stores a str with variable length
    with pytest.warns(jl.JotlightWarning, match="jotlight of a is not a string of fixed length"):
        counts = jl.open(tmp_path / "a.h5")
    np.testing.assert_array_equal(counts, COUNTS[0])


def test_a_file_cannot_refer_to_other_files_or_claim_more_than_it_holds(tmp_path):
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret").write_bytes(bytes(64))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (2, 4, 8), "u1", external=[(str(tmp_path / "secret"), 0, 64)])
    with pytest.raises(ValueError, match="in other files"):
        jl.open(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (10**9, 512, 64), "u1", chunks=(1, 512, 64))
    with pytest.raises(ValueError, match="more than a file of"):
        jl.open(tmp_path / "a.h5")


def test_a_missing_package_is_named_with_the_command_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.setitem(sys.modules, "zarr", None)
    (tmp_path / "a.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / ".zarray").write_text("{}")
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[hdf5\]'"):
        jl.open(tmp_path / "a.h5")
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[zarr\]'"):
        jl.open(tmp_path / "a")
