"""Sensors as Python objects: names of parameters, hashes, copies, and HTML."""

import copy
import dataclasses
import inspect
import pickle

import numpy as np
import pytest

import jotlight as jl


def test_parameters_need_names():
    with pytest.raises(TypeError, match=r"with names as in Sensor\(frames=16\), got 16"):
        jl.Sensor(16)
    with pytest.raises(TypeError, match=r"expected some of oversampling, frames, .* got frame"):
        jl.Sensor(frame=16)
    names = list(inspect.signature(jl.Sensor).parameters)
    assert names == [field.name for field in dataclasses.fields(jl.Sensor)]


def test_equal_sensors_have_equal_hashes_and_can_be_copied():
    maps = {"dark_counts": np.zeros((4, 6)), "mask": np.eye(4, 6, dtype=bool)}
    sensor = jl.Sensor(frames=3, **maps)
    same = jl.Sensor(frames=3, mask=maps["mask"].copy(), dark_counts=-maps["dark_counts"])
    assert sensor == same
    assert hash(sensor) == hash(same)
    assert len({sensor, same, jl.Sensor(frames=3), jl.Sensor(frames=4), jl.Sensor(frames=3)}) == 3
    for copied in (copy.deepcopy(sensor), pickle.loads(pickle.dumps(sensor))):
        assert copied == sensor


def test_subclasses_with_parameters_of_their_own_have_texts():
    class Camera(jl.Sensor):
        def __init__(self, frames=8, **others):
            super().__init__(frames=frames, dark_counts=0.1, **others)

    @dataclasses.dataclass(frozen=True, repr=False, eq=False, init=False)
    class Named(jl.Sensor):
        name: str

        def __init__(self, name, **parameters):
            super().__init__(**parameters)
            object.__setattr__(self, "name", name)

    assert repr(Camera()) == "Camera(dark_counts=0.1)"
    assert repr(Camera(frames=3, threshold=2)) == "Camera(frames=3, threshold=2, dark_counts=0.1)"
    assert repr(Named("north", frames=3)) == "Named(frames=3, name='north')"
    assert "<b>Named</b>" in Named("north")._repr_html_()


def test_notebooks_show_all_parameters():
    text = jl.Sensor(oversampling=2, efficiency=np.full((4, 6), 0.5))._repr_html_()
    assert "<th>trials per pixel</th><td>4</td>" in text
    assert "<th>dark counts</th><td>0.0</td>" in text
    assert "<th>efficiency</th><td>map of 4 x 6 jots, mean 0.5</td>" in text
    assert "<th>image</th><td>map of efficiency</td>" in text
    assert "<img" in text
    assert "<img" not in jl.Sensor()._repr_html_()


def test_numpy_numbers_become_python_numbers():
    numbers = {"oversampling": 3, "frames": 2, "gain": 4.0, "threshold": 2, "dark_counts": 0.5}
    types = np.uint8, np.int64, np.float32, np.float64, np.array
    of_numpy = {
        name: kind(value) for (name, value), kind in zip(numbers.items(), types, strict=True)
    }
    sensor = jl.Sensor(**of_numpy)
    assert sensor == jl.Sensor(**numbers)
    assert [type(value) for value in sensor.scalars().values()] == [
        int, int, float, int, str, float, float, float, int, float,
    ]  # fmt: skip
