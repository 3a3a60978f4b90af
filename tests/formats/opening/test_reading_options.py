"""How a capture is read is stated once, and survives the way to another process."""

import dataclasses
import inspect
import pickle

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats import open_capture
from jotlight.formats.opening.opening import read_capture
from jotlight.formats.opening.reading_options import ReadingOptions


def test_the_options_are_the_parameters_of_open():
    parameters = inspect.signature(jl.open).parameters.values()
    known = {each.name: each.default for each in parameters if each.default is not each.empty}
    options = {field.name: field.default for field in dataclasses.fields(ReadingOptions)}
    assert known.keys() - options.keys() == {"mosaic"}
    assert options.keys() - known.keys() == {"region"}
    assert all(known[name] == options[name] for name in known.keys() & options.keys())


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, None),
        ({"counts": False}, False),
        ({"counts_scale": 255}, True),
        ({"bit_depth": 4}, True),
        ({"bit_depth": 4, "counts": False}, False),
    ],
)
def test_means_and_readings_are_numbers_like_counts(options, expected):
    assert ReadingOptions(**options).takes_counts is expected


def test_the_frames_of_each_mean_need_a_scale():
    with pytest.raises(ValueError, match=r"^trials: states the frames of each mean, together with"):
        ReadingOptions(trials=16)


def test_a_copy_in_another_process_has_the_same_frames(tmp_path):
    bits = jl.Sensor(frames=6).expose(np.random.default_rng(0).random((16, 24)), rng=0)
    jl.save(bits, tmp_path / "a.npy")
    region = (slice(2, 9), slice(3, 20))
    options = ReadingOptions(frames=slice(1, 5), rotate=90, region=region)
    found = read_capture(tmp_path / "a.npy", pickle.loads(pickle.dumps(options)))
    expected = np.rot90(np.asarray(bits)[1:5], axes=(1, 2))[:, 2:9, 3:20]
    for each in (found, pickle.loads(pickle.dumps(found))):
        np.testing.assert_array_equal(np.asarray(each), expected)


def test_means_are_counts_in_a_stack_that_is_not_summed(tmp_path):
    counts = np.random.default_rng(0).integers(0, 11, (3, 4, 5))
    np.save(tmp_path / "means.npy", np.rint(counts * 25.5).astype(np.uint8))
    stack = open_capture(tmp_path / "means.npy", counts_scale=255, trials=10)
    assert stack.trials == 10
    np.testing.assert_array_equal(list(stack), counts)
