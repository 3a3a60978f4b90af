"""Facts about captures with dead jots."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.reports import capture_facts
from jotlight.cli.reports.capture_facts import bits_facts, readings_facts
from jotlight.sensing.bits.frames import Frames

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


def test_of_a_large_capture_the_first_frames_are_read(monkeypatch):
    monkeypatch.setattr(capture_facts, "_MAX_BYTES", 5 * 16 * 2)
    packed, read = np.zeros((100_000, 16, 2), np.uint8), []
    packed[1] = 0xFF
    packed[7:] = 0xFF

    def read_part(start, stop):
        read.append(stop)
        return packed[start:stop]

    for sensor in (None, jl.Sensor(frames=100_000, dark_counts=0.001)):
        bits = jl.Bits(Frames(packed.shape, read_part), 16, sensor)
        facts = dict(bits_facts(bits))
        assert facts["ones"] == "20.000% (the first 5 frames)"
        assert facts["frames"] == "100000"
        assert max(read) == 5


def test_of_many_readings_the_first_frames_are_read(monkeypatch):
    monkeypatch.setattr(capture_facts, "_MAX_BYTES", 2 * 4 * 6)
    values = np.full((5, 4, 6), 3, np.uint8)
    values[:2] = 1
    facts = dict(readings_facts(jl.Readings(values, jl.Sensor(frames=5, bit_depth=2))))
    assert facts["mean"] == "1 of 3 (the first 2 frames)"
    assert facts["largest"] == "0.000% of the readings are 3 (the first 2 frames)"
