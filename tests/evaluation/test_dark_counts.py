"""Dark counts that the data contradict are reported, and right ones are not."""

import warnings

import numpy as np
import pytest

import jotlight as jl

SHAPE = 48, 64
RNG = np.random.default_rng(0)
HOT = np.where(RNG.random(SHAPE) < 0.02, 3.0, 0.01)
MESSAGE = r"dark_counts: the data have \d+% of the ones that these dark counts cause without light"


def bits_of(light, sensor):
    return sensor.expose(np.full(SHAPE, light, np.float32), rng=1)


@pytest.mark.parametrize(
    "dark", [0.2, np.roll(HOT, 1), 60_000 * HOT], ids=["number", "map", "sums"]
)
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


def test_measured_dark_counts_are_not():
    sensor = jl.Sensor(frames=50, dark_counts=HOT)
    found = jl.calibrate(bits_of(0.0, sensor.replace(frames=400)), max_dark=10.0)
    measured = found.sensor(frames=50)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jl.reconstruct(jl.Bits(bits_of(0.0, sensor).packed, SHAPE[1], measured), method="mle")


def test_a_hot_jot_within_a_pixel_is_not_compared():
    dark = np.kron(np.full(SHAPE, 0.01), np.ones((2, 2)))
    dark[::2, ::2] = 9.0  # the pixel has a quarter of the ones of four such jots
    sensor = jl.Sensor(frames=50, oversampling=2, dark_counts=dark)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jl.reconstruct(bits_of(0.0, sensor), method="mle")
