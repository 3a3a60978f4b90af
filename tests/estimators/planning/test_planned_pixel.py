"""What plans of bits and of readings have in common."""

import pytest

import jotlight as jl
from jotlight.estimators.planning.planned_bits import PlannedBits
from jotlight.estimators.planning.planned_pixel import PlannedPixel
from jotlight.estimators.planning.planned_readings import PlannedReadings

VALUES = {"oversampling": 2, "frames": 8, "gain": 64.0, "efficiency": 0.5, "dark_counts": 0.1}


@pytest.mark.parametrize("max_intensity", [None, 2.0])
def test_bits_and_readings_are_planned_for_the_same_pixel(max_intensity):
    bits = PlannedBits(jl.Sensor(**VALUES), max_intensity)
    readings = PlannedReadings(jl.Sensor(bit_depth=2, **VALUES), max_intensity, 1.0)
    for pixel in (bits, readings):
        assert isinstance(pixel, PlannedPixel)
        assert (pixel.jots, pixel.efficiency, pixel.dark_counts) == (4, 0.5, 0.1)
        # 64 photons in 8 frames of 4 jots are 2 photons per jot and frame.
        assert pixel.max_light == (None if max_intensity is None else 4.0)
