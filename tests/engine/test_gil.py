"""The engine releases Python's global interpreter lock."""

import zlib

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine_module
from ticking import ticking

SENSOR = jl.Sensor(oversampling=4, kernel="cubic")
IMAGE = np.full((256, 256), 0.5, np.float32)
BITS = jl.Bits(np.ones((1800, 256, 256), np.uint8))
CALLS = {
    "expose": lambda: jl.Sensor(frames=100).expose(IMAGE, rng=0, threads=1),
    "rate": lambda: SENSOR.rate(IMAGE, threads=1),
    "probability": lambda: SENSOR.probability(IMAGE, threads=1),
    "add_block_counts": lambda: BITS.counts(4, threads=1),
}


@pytest.fixture
def ticks():
    """Count how often another thread gets the GIL, which nothing but the engine may release.

    The checksum of a buffer of this size offers the GIL, and takes a few microseconds. Sleep would
    take at least 50.
    """
    buffer = bytes(8192)
    with ticking(lambda: zlib.crc32(buffer)) as count:
        yield count


@pytest.mark.parametrize("name", CALLS)
def test_the_engine_releases_the_gil(name, ticks, monkeypatch):
    """A tick or two may fall where the engine reads its arguments, before it releases the GIL."""
    engine, during = getattr(engine_module, name), []

    def watched(*arguments):
        before = ticks[0]
        engine(*arguments)
        during.append(ticks[0] - before)

    monkeypatch.setattr(engine_module, name, watched)
    for _ in range(100):
        CALLS[name]()
        if max(during) > 10:
            return
    pytest.fail(f"at most {max(during)} ticks in each of {len(during)} calls")


def test_no_tick_falls_where_the_gil_is_held(ticks):
    before = ticks[0]
    sum(range(3_000_000))
    assert ticks[0] == before
