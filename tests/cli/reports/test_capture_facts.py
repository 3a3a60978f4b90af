"""Facts about captures with dead jots."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.reports.capture_facts import bits_facts, readings_facts

MASK = np.zeros((4, 6), bool)
MASK[:, 4:] = True
MASK[0, 0] = True


@pytest.mark.parametrize("channels", [(), (3,)])
def test_the_fraction_of_ones_is_that_of_live_jots(channels):
    sensor = jl.Sensor(oversampling=2, frames=5, mask=MASK)
    frames = np.zeros((5, 4, 6, *channels), bool)
    frames[:, MASK] = True
    frames[:2, 1] = True
    facts = dict(bits_facts(jl.Bits.from_array(frames, sensor)))
    assert facts["ones"] == f"{2 * 4 / (5 * 15):.3%} (live jots)"
    assert facts["pixels"] == "2 x 3, 0 to 20 valid bits each"


def test_without_dead_jots_all_bits_are_counted():
    sensor = jl.Sensor(oversampling=2, frames=5)
    facts = dict(bits_facts(sensor.expose(np.full((2, 3), 1e9), rng=0)))
    assert (facts["ones"], facts["pixels"]) == ("100.000%", "2 x 3, 20 bits each")


def test_the_mean_reading_is_that_of_live_jots():
    values = np.where(MASK, 3, 1) * np.ones((5, 1, 1), np.uint16)
    values[0, 3, 3] = 3
    readings = jl.Readings(values.astype(np.uint16), jl.Sensor(frames=5, bit_depth=2, mask=MASK))
    facts = dict(readings_facts(readings))
    assert facts["mean"] == f"{1 + 2 / 75:.4g} of 3 (live jots)"
    assert facts["largest"] == f"{1 / 75:.3%} of the readings are 3"
