"""The first frames of bits stand for all frames only if these are alike."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.contradictions import first_frames as module
from jotlight.evaluation.contradictions.first_frames import first_frames
from jotlight.sensing.data.pixel_counts import gray_images

SHAPE = 48, 64


@pytest.mark.parametrize(
    ("sensor", "number"),
    [(jl.Sensor(frames=50), 20), (jl.Sensor(frames=50, gain=np.repeat([1.0, 8.0], 25)), 50)],
    ids=["alike", "bracket"],
)
def test_first_frames(monkeypatch, sensor, number):
    monkeypatch.setattr(module, "_MAX_BYTES", 20 * 48 * 8)
    bits = sensor.expose(np.full(SHAPE, 0.5), rng=0)
    images, found = first_frames(gray_images(bits), sensor)
    assert found == sensor.select_frames(slice(number))
    assert images.data[0].shape == (number, *SHAPE)
    counts = gray_images(np.ones(SHAPE, np.int32))
    assert first_frames(counts, sensor) == (counts, sensor)


def test_merged_counts_on_a_finer_grid_are_compared():
    sensor = jl.Sensor(frames=50, dark_counts=0.2)
    few = jl.Merged(np.full((32, 32), 1), 50.0, sensor, upsample=2)
    with pytest.warns(jl.JotlightWarning, match="more ones without any light"):
        jl.reconstruct(few, quality="small")
    many = jl.Merged(np.full((32, 32), 45), 50.0, sensor, upsample=2)
    with pytest.warns(jl.JotlightWarning, match=r"([\d,]+) of \1 pixels are brighter"):
        jl.reconstruct(many, quality="small")
