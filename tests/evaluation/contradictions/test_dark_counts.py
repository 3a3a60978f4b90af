"""Dark counts that the data contradict are reported, and right ones are not."""

import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.contradictions import first_frames

SHAPE = 48, 64
RNG = np.random.default_rng(0)
HOT = np.where(RNG.random(SHAPE) < 0.02, 3.0, 0.01)
MESSAGE = r"dark_counts: expected .* more ones without any light than there are \(\d+% of them\)"


def bits_of(light, sensor):
    return sensor.expose(np.full(SHAPE, light, np.float32), rng=1)


@pytest.mark.parametrize("dark", [0.2, 60_000 * HOT], ids=["number", "map"])
@pytest.mark.parametrize("is_counted", [False, True])
def test_wrong_dark_counts_are_reported(dark, is_counted):
    bits = bits_of(0.1, jl.Sensor(frames=50, dark_counts=0.01))
    sensor = bits.sensor.replace(dark_counts=dark)
    data = bits.counts() if is_counted else jl.Bits(bits.packed, bits.width, sensor)
    with pytest.warns(jl.JotlightWarning, match=MESSAGE):
        jl.reconstruct(data, sensor, method="mle")


@pytest.mark.parametrize("threshold", [1, 2])
@pytest.mark.parametrize("dark", [0.2, HOT, np.full(SHAPE, 0.2)], ids=["number", "hot", "map"])
@pytest.mark.parametrize("light", [0.0, 0.5])
def test_right_dark_counts_are_not(light, dark, threshold):
    sensor = jl.Sensor(frames=50, dark_counts=dark, threshold=threshold)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jl.reconstruct(bits_of(light, sensor), method="mle")


# In short dark captures, the largest measured values are too large by chance.
@pytest.mark.parametrize(("dark", "frames"), [(0.001, 100), (0.01, 100), (0.0001, 1000)])
def test_measured_dark_counts_are_not(dark, frames):
    sensor = jl.Sensor(frames=frames, dark_counts=dark)
    black = np.zeros((256, 256), np.float32)
    measured = jl.calibrate(sensor.expose(black, rng=1)).sensor(frames=50)
    bits = sensor.replace(frames=50).expose(black, rng=2)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "dark_counts")
        warnings.filterwarnings("ignore", ".* no valid bit")
        jl.reconstruct(jl.Bits(bits.packed, 256, measured), method="mle")


@pytest.mark.parametrize("order", [1, -1])
def test_each_image_is_compared(order):
    sensor = jl.Sensor(frames=50, dark_counts=0.01, max_intensity=2.0)
    images = [bits_of(light, sensor).counts() for light in (0.0, 2.0)][::order]
    with pytest.warns(jl.JotlightWarning, match=MESSAGE):
        jl.reconstruct(np.stack(images), sensor.replace(dark_counts=0.2), method="mle")


def test_the_first_frames_of_many_are_compared(monkeypatch):
    monkeypatch.setattr(first_frames, "_MAX_BYTES", 20 * 48 * 8)
    bits = bits_of(0.0, jl.Sensor(frames=50, dark_counts=0.01))
    sensor = bits.sensor.replace(dark_counts=0.2)
    with pytest.warns(jl.JotlightWarning, match=MESSAGE):
        jl.reconstruct(jl.Bits(bits.packed, bits.width, sensor), method="mle")


def test_a_hot_jot_within_a_pixel_is_not_compared():
    dark = np.kron(np.full(SHAPE, 0.01), np.ones((2, 2)))
    dark[::2, ::2] = 9.0  # the pixel has a quarter of the ones of four such jots
    sensor = jl.Sensor(frames=50, oversampling=2, dark_counts=dark)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jl.reconstruct(bits_of(0.0, sensor), method="mle")
