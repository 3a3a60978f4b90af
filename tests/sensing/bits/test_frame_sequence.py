"""Bits and readings as sequences of frames: comparison, membership, and sums."""

import copy
import pickle

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.bits import frame_sequence

IMAGE = np.linspace(0, 1, 15).reshape(3, 5)
BITS = jl.Sensor(frames=4).expose(IMAGE, rng=0)
READINGS = jl.Sensor(frames=4, gain=9.0, bit_depth=3).expose(IMAGE, rng=0)


@pytest.fixture(params=[BITS, READINGS], ids=["bits", "readings"])
def data(request, monkeypatch):
    monkeypatch.setattr(frame_sequence, "_MAX_VALUES", 30)  # two frames at once
    return request.param


def test_copies_and_files_are_equal(data, tmp_path):
    jl.save(data, tmp_path / "capture.npy")
    for other in (
        copy.deepcopy(data),
        pickle.loads(pickle.dumps(data)),
        jl.open(tmp_path / "capture.npy"),
    ):
        assert other == data
        assert hash(other) == hash(data)


def test_other_values_shapes_and_sensors_differ(data):
    array = data.to_array().copy()
    array[-1, -1, -1] ^= 1
    kind = jl.Bits.from_array if data is BITS else jl.Readings
    assert kind(array, data.sensor) != data
    assert kind(data.to_array(), data.sensor.replace(dark_counts=0.1)) != data
    assert data[:2] != data
    assert data != 3
    assert (data == data.to_array()).all()  # arrays are compared elementwise


def test_padding_does_not_matter():
    padded = BITS.packed | 1
    assert jl.Bits(padded, 5, BITS.sensor) == BITS


def test_frames_are_members(data):
    assert data[3] in data
    other = data[3] + 1 if data is READINGS else ~data[3]
    assert other not in data[3:]
    with pytest.raises(ValueError, match=r"expected a frame of shape \(3, 5\), got \(2,\)"):
        [1, 2] in data  # noqa: B015


def test_readings_are_summed_as_numpy_does():
    array = READINGS.to_array()
    for axis in (None, 0, 1, (0, 1), -1):
        expected = array.sum(axis)
        np.testing.assert_array_equal(np.sum(READINGS, axis=axis), expected)
        np.testing.assert_array_equal(READINGS.sum(axis), expected)
    np.testing.assert_array_equal(READINGS.sum(), array.sum(axis=0))
    assert np.sum(READINGS, axis=0, keepdims=True).shape == (1, 3, 5)
    with pytest.raises(ValueError, match="oversampling: needs axis 0"):
        READINGS.sum(1, oversampling=3)


def test_a_subclass_with_the_same_frames_is_equal_and_has_the_same_hash():
    class Own(jl.Bits):
        pass

    own = Own(BITS.packed, BITS.width, BITS.sensor)
    assert own == BITS
    assert len({own, BITS}) == 1
