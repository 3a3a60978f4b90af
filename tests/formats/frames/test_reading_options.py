"""How a capture is read is stated once, and survives the way to another process."""

import dataclasses
import inspect
import pickle

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats import open_capture
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.opening.opening import read_capture


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
        ({"unpacked": True}, True),
    ],
)
def test_means_and_readings_are_numbers_like_counts(options, expected):
    assert ReadingOptions(**options).takes_counts is expected


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"trials": 16}, "trials: states the frames of each mean, together with"),
        ({"bit_depth": 4, "counts": False}, "bit_depth: is for images of readings, but bits"),
        ({"bit_depth": 4, "unpacked": True}, "bit_depth: is for images of readings, but bits"),
        ({"bit_depth": 4, "counts_scale": 1}, "counts_scale: .* leave out one of the two"),
        ({"counts": True, "unpacked": True}, "counts: expected at most one of counts and unp"),
        ({"counts_scale": 1, "unpacked": True}, "counts_scale: expected at most one"),
    ],
    ids=str,
)
def test_options_that_contradict_each_other_are_refused(options, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        ReadingOptions(**options)


VALUES = {
    "bit_depth": (0, 1, 17, 4.5, 10**30),
    "counts_scale": (0, np.inf),
    "trials": (0, 2.5),
    "width": (0, 2.5),
    "rotate": (45, 90.0),
    "key": (0,),
}
"""Bad values of each option."""


@pytest.mark.parametrize("name", VALUES)
def test_a_bad_value_is_an_error_of_its_own_option_whatever_the_file_holds(tmp_path, name):
    jl.save(jl.Bits.from_array(np.ones((4, 8, 8), bool)), tmp_path / "a.npy")
    others = {"counts_scale": 1} if name == "trials" else {}
    for value in (*VALUES[name], -1, True, np.nan, [4], *(["4"] if name != "key" else [])):
        with pytest.raises((TypeError, ValueError), match=f"^{name}: expected "):
            jl.open(tmp_path / "a.npy", **{name: value}, **others)


@pytest.mark.parametrize("name", ["counts", "unpacked", "isolate", "storage_options", "frames"])
def test_options_of_other_types_are_refused(name):
    for value in (1, "no", *([None] if name == "isolate" else [])):
        with pytest.raises(TypeError, match=f"^{name}: expected "):
            ReadingOptions(**{name: value})


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
