"""Objects keep arrays that the caller cannot change."""

import copy
import pickle

import numpy as np
import pytest

import jotlight as jl
from jotlight.arrays import frozen, read_only
from jotlight.motion.motion import Motion

SENSOR = jl.Sensor(frames=8)
NODES, INFORMATION = np.zeros((1, 2, 2, 1, 1), np.float32), np.ones((1, 2, 3, 1, 1), np.float32)
LABELS = np.zeros((16, 16), np.uint8)
OBJECTS = [
    jl.Sensor(dark_counts=np.full((8, 8), 0.1), mask=np.eye(8, dtype=bool), mosaic="RGGB"),
    jl.Merged(np.ones((8, 8), int), np.full((8, 8), 8.0), SENSOR, flags=np.eye(8, dtype=bool)),
    jl.Likelihood([1, 2], [3, 4], dark_counts=[0.1, 0.2]),
    Motion(NODES, LABELS, np.array([0.0, 6.0]), 0.0, "affine", INFORMATION),
]


def test_frozen_arrays_are_copied_once():
    array = np.zeros((2, 3))
    own = frozen(array)
    assert not np.shares_memory(own, array)
    assert frozen(own) is own
    assert frozen(own, np.float32).dtype == np.float32
    assert not np.shares_memory(frozen(read_only(array)), array)
    with pytest.raises(ValueError, match="read-only"):
        own[0] = 1


@pytest.mark.parametrize("dtype", [np.int32, np.int64])
def test_merged_counts_do_not_change_with_the_callers_arrays(dtype):
    maps = {
        "ones": np.ones((8, 8), dtype),
        "trials": np.full((8, 8), 8.0),
        "dark_counts": np.zeros((8, 8)),
        "efficiency": np.ones((8, 8)),
        "acceptance": np.ones((8, 8), np.float32),
        "posterior_error": np.ones((8, 8), np.float32),
        "flags": np.zeros((8, 8), bool),
    }
    merged = jl.Merged(**maps, sensor=SENSOR)
    for name, array in maps.items():
        before = getattr(merged, name).copy()
        array[0, 0] = 10**6
        np.testing.assert_array_equal(getattr(merged, name), before)
    assert np.isfinite(jl.uncertainty(merged, method="mle").standard_error).all()


def test_a_likelihood_does_not_change_with_the_callers_arrays():
    maps = {
        "ones": np.ones(4, np.int32),
        "trials": np.full(4, 8.0),
        "dark_counts": np.zeros(4),
        "efficiency": np.ones(4),
    }
    likelihood = jl.Likelihood(**maps)
    before = likelihood.value(0.5)
    for array in maps.values():
        array[0] = 7
    assert likelihood.value(0.5) == before


def test_a_motion_does_not_change_with_the_callers_arrays():
    nodes, labels = np.zeros((1, 2, 2, 1, 1), np.float32), np.zeros((16, 16), np.uint8)
    times, information = np.array([0.0, 6.0]), np.ones((1, 2, 3, 1, 1), np.float32)
    motion = Motion(nodes, labels, times, 0.0, "affine", information)
    nodes[:], labels[:], times[:] = 3, 9, np.nan
    assert (motion.at(3) == 0).all()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))])
@pytest.mark.parametrize("original", OBJECTS, ids=lambda each: type(each).__name__)
def test_arrays_of_copies_are_read_only_too(original, copied):
    mosaic = getattr(original, "mosaic", None)
    for each in filter(None, (original, mosaic)):
        same = vars(copied(each))
        arrays = [name for name, value in vars(each).items() if isinstance(value, np.ndarray)]
        assert arrays
        for name in arrays:
            np.testing.assert_array_equal(same[name], vars(each)[name])
            assert not same[name].flags.writeable, name
