"""z = arcsin √p against SciPy, its inverse, and its slope."""

import numpy as np
import pytest
from scipy.special import gammainc

import jotlight as jl
from jotlight.evaluation.intervals.stabilized import intensity_of, slope_of, stabilize


@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("dark_counts", [0.0, 0.1])
def test_z_and_the_intensity_are_inverse(threshold, dark_counts):
    sensor = jl.Sensor(frames=4, threshold=threshold, max_intensity=20.0, gain=3.0)
    intensity = np.linspace(0.01, 20, 50)[None]
    z = stabilize(intensity, sensor, 0.8, dark_counts)
    p = gammainc(threshold, 0.8 * 0.75 * intensity + dark_counts)
    np.testing.assert_allclose(np.sin(z) ** 2, p, rtol=1e-9)
    np.testing.assert_allclose(intensity_of(z, sensor, 0.8, dark_counts), intensity, rtol=1e-5)


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_the_slope_is_that_of_z(threshold):
    sensor = jl.Sensor(frames=4, threshold=threshold, max_intensity=20.0, gain=3.0)
    light, step = np.array([[0.3, 2.0, 15.0]]), 1e-5
    high, low = (stabilize(light + sign * step, sensor, 0.8, 0.1) for sign in (1, -1))
    numeric = (high - low) / (2 * step) / sensor.light_per_intensity
    np.testing.assert_allclose(slope_of(light, sensor, 0.8, 0.1), numeric, rtol=1e-5)


def test_saturated_and_dark_jots_have_a_slope_of_0():
    sensor = jl.Sensor(frames=1, threshold=2, max_intensity=1e4)
    assert slope_of(np.array([[0.0, 1e4]]), sensor, 1.0, 0.0).tolist() == [[0.0, 0.0]]
