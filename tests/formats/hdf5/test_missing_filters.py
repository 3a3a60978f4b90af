"""HDF5 files whose filters the library lacks."""

import sys

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.hdf5.library import Hdf5Library

COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


def write_with_filter(path, number):
    """Write frames whose second chunk claims a filter that the library lacks."""
    h5py = pytest.importorskip("h5py")
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_chunk((4, 8, 8))
    properties.set_filter(number, h5py.h5z.FLAG_OPTIONAL)
    space = h5py.h5s.create_simple((8, 8, 8))
    with h5py.File(path, "w") as file:
        data_set = h5py.h5d.create(file.id, b"x", h5py.h5t.NATIVE_UINT16, space, properties)
        data_set.write_direct_chunk((0, 0, 0), bytes(512), filter_mask=1)
        data_set.write_direct_chunk((4, 0, 0), b"compressed", filter_mask=0)


@pytest.mark.parametrize(("number", "name"), [(32008, "Bitshuffle"), (511, "511")])
@pytest.mark.parametrize("isolate", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_filter_that_the_library_lacks_is_named(tmp_path, number, name, isolate):
    path = tmp_path / "a.h5"
    write_with_filter(path, number)
    message = rf"a\.h5: x is stored with the filter {name}, .*: pip install hdf5plugin"
    with pytest.raises(ValueError, match=message):
        jl.open(path, frames=slice(0, 8), isolate=isolate)
    assert jl.open(path, frames=slice(0, 4), isolate=isolate).max() == 0


def test_the_filters_of_hdf5plugin_are_used(tmp_path, monkeypatch):
    h5py = pytest.importorskip("h5py")
    write_with_filter(tmp_path / "a.h5", 511)
    (tmp_path / "hdf5plugin.py").write_text("import h5py\nh5py.added = True")
    monkeypatch.setattr(h5py, "added", False, raising=False)
    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda number: h5py.added)
    monkeypatch.delitem(sys.modules, "hdf5plugin", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    (found,) = Hdf5Library().list_data_sets(str(tmp_path / "a.h5"), "jotlight")
    assert found.missing_filters == ()
    monkeypatch.delitem(sys.modules, "hdf5plugin")
