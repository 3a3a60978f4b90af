"""Intervals of the colors of three counts per pixel."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets import photograph

SCENE = photograph("astronaut")[60:140, 180:260].astype(np.float64)


@pytest.mark.parametrize("frames", [1, pytest.param(8, marks=pytest.mark.slow)])
def test_the_intervals_of_the_color_network_are_its_own(frames):
    sensor = jl.Sensor(frames=frames)
    bits = sensor.expose(SCENE, rng=0, channel_axis=-1)
    found = jl.uncertainty(bits, confidence_level=0.9)
    estimate = jl.reconstruct(bits)
    assert ((found.low <= estimate) & (estimate <= found.high)).all()
    covered = ((found.low <= SCENE) & (found.high >= SCENE)).mean()
    assert 0.85 < covered < 0.97
    # Of another method, the difference from the network medium is added.
    medium = jl.uncertainty(bits, quality="medium", confidence_level=0.9)
    other = jl.uncertainty(bits, quality="small", confidence_level=0.9)
    width, of_medium, of_other = (
        np.median(each.high - each.low) for each in (found, medium, other)
    )
    assert width < 0.95 * of_medium < of_other


@pytest.mark.slow
def test_each_image_of_a_stack_has_the_intervals_of_its_own():
    sensor = jl.Sensor(frames=8)
    counts = np.stack(
        [sensor.expose(SCENE[:32, :40], rng=rng, channel_axis=-1).counts() for rng in (0, 1)]
    )
    stack = jl.uncertainty(counts, sensor, channel_axis=-1)
    for index in (0, 1):
        single = jl.uncertainty(counts[index], sensor, channel_axis=-1)
        np.testing.assert_array_equal(stack.low[index], single.low)
        np.testing.assert_array_equal(stack.high[index], single.high)
