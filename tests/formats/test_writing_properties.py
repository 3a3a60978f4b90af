"""Any bits of any sensor are saved and opened."""

import tempfile
from pathlib import Path

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl
from any_sensor import sensors_and_bits


@pytest.mark.slow
@given(sensors_and_bits())
def test_saved_bits_are_opened_with_their_width_and_sensor(case):
    sensor, values = case
    bits = jl.Bits.from_array(values, sensor)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cube.npy"
        jl.save(bits, path)
        loaded = jl.open(path)
        assert loaded.shape == bits.shape
        assert loaded.sensor == sensor
        np.testing.assert_array_equal(loaded.to_array(), values)


@pytest.mark.slow
@given(
    hnp.arrays(bool, hnp.array_shapes(min_dims=3, max_dims=3, max_side=20)),
    st.integers(0, 4),
)
def test_saved_bits_of_any_width_and_color_are_opened(values, channels):
    if channels:
        values = np.stack([np.roll(values, shift) for shift in range(channels)], axis=-1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cube.npy"
        jl.save(jl.Bits.from_array(values), path)
        np.testing.assert_array_equal(jl.open(path).to_array(), values)
