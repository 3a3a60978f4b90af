"""`jl.save`, the counterpart of `jl.open`."""

import json

import numpy as np
import pytest

import jotlight as jl

SENSOR = jl.Sensor(oversampling=2, frames=3, mask=np.eye(4, 6, dtype=bool))
BITS = SENSOR.expose(np.full((2, 3), 0.5), rng=0)


def test_saved_bits_are_opened_with_their_width_and_sensor(tmp_path):
    jl.save(BITS, tmp_path / "capture.npy")
    opened = jl.open(tmp_path / "capture.npy")
    assert (opened.shape, opened.sensor) == (BITS.shape, SENSOR)
    np.testing.assert_array_equal(opened.to_array(), BITS.to_array())


def test_any_program_can_unpack_the_file(tmp_path):
    jl.save(BITS, str(tmp_path / "capture.npy"))
    packed = np.load(tmp_path / "capture.npy")
    np.testing.assert_array_equal(np.unpackbits(packed, axis=2, count=6), BITS.to_array())
    description = json.loads((tmp_path / "capture.json").read_text())
    assert description["maps"] == {"mask": "capture.mask.npy"}
    np.testing.assert_array_equal(np.load(tmp_path / "capture.mask.npy"), SENSOR.mask)


def test_the_provenance_is_saved_and_becomes_the_origin(tmp_path):
    jl.save(BITS, tmp_path / "first.npy")
    jl.save(jl.open(tmp_path / "first.npy")[:2], tmp_path / "second.npy")
    origin = jl.open(tmp_path / "second.npy").provenance.origin
    assert (origin.name, origin.notes) == ("first.npy", ("frames 0:2 of 3",))


@pytest.mark.parametrize("other", [np.ones((2, 3)), np.ones((2, 3), bool), "capture.npy", None])
def test_only_bits_and_counts_are_saved(tmp_path, other):
    with pytest.raises(
        TypeError, match=r"data: expected jotlight\.Bits or an array of counts, got"
    ):
        jl.save(other, tmp_path / "capture.npy")
    assert not list(tmp_path.iterdir())


def test_a_name_that_implies_no_format_is_refused(tmp_path):
    with pytest.raises(ValueError, match="this name implies no single format"):
        jl.save(BITS, tmp_path / "capture.bin")
    assert not list(tmp_path.iterdir())
