"""Moving scenes behind a color mosaic."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets import moving, photograph


@pytest.mark.slow
def test_the_bits_are_those_of_the_light_behind_the_filters():
    sensor = jl.Sensor(frames=400, mosaic="RGGB")
    scene = moving(photograph("astronaut"), "static", sensor=sensor, shape=(24, 32), rng=0)
    assert scene.image().shape == (24, 32, 3)
    assert scene.bits.shape == (400, 24, 32)
    light = sensor.mosaic.light(scene.image())
    probability = -np.expm1(-scene.sensor.light_per_intensity * light)
    error = scene.bits.counts() - 400 * probability
    z = error / np.sqrt(400 * probability * (1 - probability))
    assert abs(z).max() < 5  # 768 pixels, each with a probability below 1e-6


def test_photons_are_the_mean_behind_the_filters():
    sensor = jl.Sensor(frames=16, mosaic="RGBW")
    scene = moving(photograph("astronaut"), sensor=sensor, shape=(24, 32), photons=0.3, rng=0)
    rate = scene.sensor.light_per_intensity * sensor.mosaic.light(scene.image())
    assert rate.mean() == pytest.approx(0.3, rel=1e-6)


def test_a_gray_photograph_is_refused():
    with pytest.raises(ValueError, match="photograph: expected red, green, and blue"):
        moving(sensor=jl.Sensor(frames=16, mosaic="RGGB"), rng=0)
