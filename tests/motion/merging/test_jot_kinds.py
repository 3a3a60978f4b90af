"""Kinds of jots: which sensors have them, and which data are refused."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.motion.merging.jot_kinds import (
    frames_of_kinds,
    has_kinds,
    sensors_of_kinds,
    without_kinds,
)
from jotlight.sensing.parameters.provenance import Provenance

SENSORS = [
    jl.Sensor(frames=4, mosaic="RGGB"),
    jl.Sensor(frames=4, threshold=1 + np.indices((8, 8)).sum(axis=0) % 2),
]


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_each_jot_is_of_one_kind(sensor):
    assert has_kinds(sensor)
    assert not has_kinds(without_kinds(sensor))
    kinds = sensors_of_kinds(sensor, (8, 8))
    assert not any(has_kinds(each) for each in kinds)
    np.testing.assert_array_equal(np.sum([~each.mask for each in kinds], axis=0), 1)
    bits = jl.Bits.from_array(np.zeros((4, 8, 8), bool), sensor=sensor)
    assert frames_of_kinds(bits, None) == (bits, sensor)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
@pytest.mark.parametrize(
    ("data", "message"),
    [
        (np.zeros((4, 8, 8)), "expected bits or counts for a sensor with a m"),
        (jl.Bits.from_array(np.zeros((4, 8, 8, 3), bool)), "expected gray frames .* have one"),
        (
            CountStack(np.zeros((2, 8, 8, 3), np.uint8), Provenance("npy", "a.npy"), 2),
            "expected gray frames .* have one",
        ),
    ],
)
def test_other_data_are_refused(sensor, data, message):
    with pytest.raises(ValueError, match=message):
        frames_of_kinds(data, sensor)


def test_other_sensors_have_no_kinds():
    assert frames_of_kinds(np.zeros(3), jl.Sensor()) is None
    assert frames_of_kinds(jl.Bits.from_array(np.zeros((1, 2, 2), bool)), None) is None
