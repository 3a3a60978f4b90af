"""Attributes of arrays that bits and readings do not have."""

import copy
import pickle

import numpy as np
import pytest

import jotlight as jl

BITS = jl.Bits.from_array(np.eye(4, dtype=bool))
READINGS = jl.Readings(np.arange(24).reshape(2, 3, 4) % 4, jl.Sensor(frames=2, bit_depth=2))


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("mean", r"bits\.counts\(1\) / len\(bits\)"),
        ("astype", r"np\.asarray\(bits\)\.astype"),
        ("save", r"jotlight\.save\(bits, path\)"),
        ("banana", "'banana'$"),
    ],
)
def test_a_missing_attribute_says_what_to_write(name, hint):
    with pytest.raises(AttributeError, match=hint):
        getattr(BITS, name)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("mean", r"readings\.sum\(\) / len\(readings\)"),
        ("counts", r"readings\.sum\(\)"),
        ("dtype", r"np\.asarray\(readings\)\.dtype"),
        ("save", r"jotlight\.save\(readings, path\)"),
        ("banana", "'banana'$"),
    ],
)
def test_readings_have_hints_of_their_own(name, hint):
    with pytest.raises(AttributeError, match=hint):
        getattr(READINGS, name)


def test_the_hints_are_right():
    np.testing.assert_array_equal(BITS.counts(1) / len(BITS), np.asarray(BITS).mean(0))
    np.testing.assert_array_equal(READINGS.sum() / len(READINGS), np.asarray(READINGS).mean(0))


@pytest.mark.parametrize("data", [BITS, READINGS], ids=["bits", "readings"])
def test_copies_and_numpy_functions_do_not_need_the_attributes(data):
    for same in (copy.copy(data), copy.deepcopy(data), pickle.loads(pickle.dumps(data))):
        np.testing.assert_array_equal(np.asarray(same), np.asarray(data))
    assert np.mean(BITS) == 0.25


def test_dask_is_referred_to_the_lazy_array_of_bits():
    array = pytest.importorskip("dask.array")
    bits = jl.Bits.from_array(np.ones((4, 2, 9), bool))
    with pytest.raises(AttributeError, match=r"'dtype'; .*, and bits\.to_dask\(\) is a lazy array"):
        array.from_array(bits)
    np.testing.assert_array_equal(bits.to_dask().compute(), bits.packed)
