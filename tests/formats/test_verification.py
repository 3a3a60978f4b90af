"""Verification of captures: checksums are compared, and every frame is read."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import file_names, random_bits
from jotlight.formats.registry import FORMATS
from jotlight.formats.verification import verify_capture


def test_all_frames_are_read_and_progress_reaches_the_end(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((5, 2, 3), np.uint8))
    fractions = []
    summary = verify_capture(tmp_path / "a.npy", progress=fractions.append, width=20)
    assert "all 5 frames are readable" in summary
    assert "no checksum" in summary
    assert fractions[-1] == 1


def test_a_missing_file_and_an_unknown_format_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"a\.npy"):
        verify_capture(tmp_path / "a.npy")
    (tmp_path / "a.npy").write_bytes(b"text")
    with pytest.raises(ValueError, match="format: expected one of"):
        verify_capture(tmp_path / "a.npy", format="film")


@pytest.fixture
def refused(tmp_path, monkeypatch):
    """The path of bits in HDF5, whose format reports a difference from their checksums."""
    pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    jl.save(random_bits((4, 3, 16, 3)), path)

    def verify(checked):
        raise ValueError(f"{checked}: is damaged")

    monkeypatch.setitem(FORMATS, "hdf5", dataclasses.replace(FORMATS["hdf5"], verify=verify))
    return path


def test_bits_of_a_file_that_differs_from_its_checksums_are_read_but_not_saved(refused, tmp_path):
    with pytest.raises(ValueError, match="is damaged"):
        verify_capture(refused)
    bits = jl.open(refused, rotate=90)
    bits.counts(1)
    for selected in (bits, bits[1:], bits[::2], bits.channels()[1]):
        with pytest.raises(ValueError, match="is damaged"):
            jl.save(selected, tmp_path / "b.npy")
    assert file_names(tmp_path) == ["a.h5"]
