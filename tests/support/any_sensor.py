"""Strategies that draw any sensor and any bits, for the tests of properties."""

import warnings

import hypothesis.extra.numpy as hnp
import numpy as np
from hypothesis import strategies as st

import jotlight as jl

NUMBERS = {
    "gain": st.none() | st.floats(0.01, 1e5),
    "threshold": st.integers(1, 12),
    "efficiency": st.floats(0.01, 1),
    "max_intensity": st.floats(0.01, 100),
    "dark_counts": st.floats(0, 3),
    "exposure_time": st.none() | st.floats(1e-9, 10),
}
IMAGE_SHAPES = hnp.array_shapes(min_dims=2, max_dims=2, max_side=9)


@st.composite
def sensors(draw, **fixed):
    numbers = draw(st.fixed_dictionaries({k: v for k, v in NUMBERS.items() if k not in fixed}))
    return jl.Sensor(**numbers, **fixed)


@st.composite
def sensors_and_bits(draw):
    """A sensor with or without maps, and any bits that fit it."""
    side, frames = draw(st.integers(1, 4)), draw(st.integers(1, 5))
    height, width = (side * draw(st.integers(1, 5)) for _ in range(2))
    maps = {}
    if draw(st.booleans()):
        maps["mask"] = draw(hnp.arrays(bool, (height, width)))
        maps["mask"][0, 0] = False
    if draw(st.booleans()):
        maps["dark_counts"] = draw(
            hnp.arrays(np.float32, (height, width), elements=st.floats(0, 3, width=32))
        )
    sensor = draw(sensors(oversampling=side, frames=frames, **maps))
    return sensor, draw(hnp.arrays(bool, (frames, height, width)))


def without_warnings(function, *arguments, **options):
    """Return the result without the warnings about inpainted dead pixels."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        return function(*arguments, **options)


def assert_in_range(estimate, sensor):
    assert np.isfinite(estimate).all()
    assert estimate.min() >= 0
    assert estimate.max() <= np.float32(sensor.max_intensity)
