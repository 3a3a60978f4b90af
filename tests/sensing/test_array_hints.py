"""Attributes of arrays that bits do not have."""

import copy
import pickle

import numpy as np
import pytest

import jotlight as jl

BITS = jl.Bits.from_array(np.eye(4, dtype=bool))


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


def test_the_hints_are_right():
    np.testing.assert_array_equal(BITS.counts(1) / len(BITS), np.asarray(BITS).mean(0))


def test_copies_and_numpy_functions_do_not_need_the_attributes():
    for same in (copy.copy(BITS), copy.deepcopy(BITS), pickle.loads(pickle.dumps(BITS))):
        np.testing.assert_array_equal(np.asarray(same), np.asarray(BITS))
    assert np.mean(BITS) == 0.25
