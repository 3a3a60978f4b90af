"""Numbers that stand for a whole sensor."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.likelihood.reference import reference_jot, saturation_intensity

DARK = np.float32([[0.0, 0.1, 0.2, 0.9]])
EFFICIENCY = np.float32([[0.5, 0.25, 1.0, 0.125]])
DEAD = np.array([[False, False, False, True]])


def test_the_reference_jot_has_the_medians_of_the_live_jots():
    sensor = jl.Sensor(dark_counts=DARK, efficiency=EFFICIENCY, mask=DEAD)
    assert reference_jot(sensor) == (0.5, float(DARK[0, 1]))


def test_the_reference_jot_of_a_sensor_without_maps_has_its_numbers():
    assert reference_jot(jl.Sensor(dark_counts=0.25, efficiency=0.5)) == (0.5, 0.25)


def test_the_reference_jot_of_dead_jots_has_the_medians_of_all():
    sensor = jl.Sensor(efficiency=EFFICIENCY, mask=np.ones((1, 4), bool))
    assert reference_jot(sensor)[0] == np.median(EFFICIENCY)


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_saturation_intensity_clips_only_saturated_pixels(threshold):
    sensor = jl.Sensor(frames=16, threshold=threshold, dark_counts=0.125, efficiency=0.5)
    maximum = saturation_intensity(sensor)
    estimate = jl.mle(np.array([[15, 16]]), sensor.replace(max_intensity=maximum))
    assert estimate[0, 0] < estimate[0, 1] == np.float32(maximum)


def test_the_saturation_intensity_is_that_of_the_darkest_live_jots():
    varied = jl.Sensor(frames=4, dark_counts=DARK, efficiency=EFFICIENCY, mask=DEAD)
    darkest = jl.Sensor(frames=4, dark_counts=0.0, efficiency=0.25)
    assert saturation_intensity(varied) == pytest.approx(saturation_intensity(darkest))
