"""Verification of captures: checksums are compared, and every frame is read."""

import contextlib
import dataclasses
import warnings

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_bits
from folders import file_names
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


MAPPED = jl.Sensor(frames=2, mask=np.eye(3, 9, dtype=bool))


def undetected_flips(path, file, step):
    """Return the bits of a file that can be flipped so that verifying a capture does not notice.

    Only every `step`-th bit is flipped.
    """
    content = file.read_bytes()
    unnoticed = []
    for bit in range(0, 8 * len(content), step):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        file.write_bytes(damaged)
        with warnings.catch_warnings(), contextlib.suppress(ValueError, OSError):
            warnings.simplefilter("ignore")
            verify_capture(path)
            unnoticed.append(bit)
    file.write_bytes(content)
    return unnoticed


@pytest.mark.parametrize("step", [67, pytest.param(3, marks=pytest.mark.exhaustive)])
@pytest.mark.parametrize("name", ["a.npy", "a.npy.gz", "a.npz", "a.tif"])
def test_flipped_bits_in_every_file_are_detected(tmp_path, name, step):
    bits = random_bits((2, 3, 9), MAPPED)
    for data in (bits, bits.counts()):
        folder = tmp_path / type(data).__name__
        folder.mkdir()
        if isinstance(data, jl.Bits) and name in ("a.npz", "a.tif"):
            continue
        jl.save(data, folder / name)
        files = sorted(folder.iterdir())
        expected = f"{len(files)} files match" if len(files) > 1 else "1 file matches"
        assert verify_capture(folder / name).startswith(expected)
        for file in files:
            assert undetected_flips(folder / name, file, step) == [], file.name
