"""Bits that exceed the memory are refused before they are unpacked."""

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from jotlight.memory import available_bytes
from jotlight.sensing.bits.frames import Frames


def test_bits_that_exceed_the_memory_are_not_unpacked():
    packed = Frames((10**9, 1000, 1000), lambda start, stop: np.zeros((stop - start, 1000, 1000)))
    for unpack in (np.asarray, jl.Bits.to_array, lambda bits: np.asarray(bits.packed)):
        with pytest.raises(MemoryError, match=r"got \d.* GB; take a part of .*\[:100\]"):
            unpack(jl.Bits(packed))


def test_the_type_of_an_array_counts_toward_its_memory(monkeypatch):
    monkeypatch.setattr("jotlight.memory.available_bytes", lambda: 5 * 4 * 6)
    bits = jl.Bits.from_array(random_frames((5, 4, 6)))
    assert np.asarray(bits, np.int8).shape == (5, 4, 6)
    with pytest.raises(MemoryError, match=r"bits\.windows\(100\), or count their ones"):
        np.asarray(bits, np.float32)


def test_frames_are_searched_for_a_frame():
    bits = jl.Bits.from_array(random_frames((5, 4, 6)))
    assert bits[3] in bits
    assert ~bits[3] not in bits[3:4]
    with pytest.raises(ValueError, match=r"expected a frame of shape \(4, 6\), got \(\)"):
        True in bits  # noqa: B015


def test_the_available_memory_is_known_on_every_system(monkeypatch, tmp_path):
    assert 1 << 20 < available_bytes() < 1 << 60
    monkeypatch.setattr("jotlight.memory._MEMORY_INFO", tmp_path / "missing")
    assert available_bytes() == 1 << 34
