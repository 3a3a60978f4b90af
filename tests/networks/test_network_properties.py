"""Properties of the networks for every sensor."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl
from any_sensor import assert_in_range, sensors, sensors_and_bits, without_warnings


@pytest.mark.slow
@given(sensors_and_bits(), st.floats(0.05, 5), st.integers(5, 200))
def test_the_initial_network_stays_between_0_and_the_largest_intensity(case, sigma, coefficients):
    sensor, bits = case
    network = jl.Network.initial(sensor, sigma=sigma, coefficients=coefficients)
    estimate = without_warnings(network.reconstruct, jl.Bits.from_array(bits), sensor)
    assert_in_range(estimate, sensor)


@given(sensors(frames=4), st.floats(0.1, 3), st.booleans())
def test_saved_networks_are_loaded(sensor, sigma, tied):
    network = jl.Network.initial(sensor, sigma=sigma, tied=tied)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.safetensors"
        network.save(path)
        loaded = jl.Network.load(path)
    assert loaded.sensor == sensor
    bits = jl.Bits.from_array(np.random.default_rng(0).random((4, 5, 6)) < 0.5)
    np.testing.assert_array_equal(loaded.reconstruct(bits), network.reconstruct(bits))
