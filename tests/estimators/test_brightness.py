import numpy as np
import pytest
from scipy.stats import poisson

import jotlight as jl
from jotlight.estimators.brightness import (
    HEADROOM,
    estimate_brightness,
    max_measurable_intensity,
    training_sensor,
    unit_scale,
)
from jotlight.layout import Layout
from jotlight.sensing.data.pixel_counts import GrayImages


@pytest.mark.parametrize("threshold", [1, 3])
@pytest.mark.parametrize("frames", [1, 16, 1000])
def test_at_the_maximum_measurable_intensity_half_a_zero_is_expected(threshold, frames):
    sensor = jl.Sensor(
        frames=frames, threshold=threshold, gain=2.5 * frames, efficiency=0.5, dark_counts=0.1
    )
    rate = 0.5 * 2.5 * max_measurable_intensity(sensor) + 0.1
    assert frames * poisson.cdf(threshold - 1, rate) == pytest.approx(0.5, rel=1e-6)


@pytest.mark.parametrize("intensity", [0.02, 0.4, 3.0])
def test_the_brightness_of_a_constant_scene_is_its_intensity(intensity):
    sensor = jl.Sensor(frames=100, dark_counts=0.01)
    bits = sensor.expose(np.full((64, 64), intensity), rng=0)
    assert estimate_brightness(bits, sensor) == pytest.approx(intensity, rel=0.1, abs=0.008)
    assert estimate_brightness(bits.counts(), sensor) == estimate_brightness(bits, sensor)


def test_small_highlights_do_not_count_and_bright_regions_do():
    scene = np.full((100, 100), 0.1)
    sensor = jl.Sensor(frames=400)
    scene[50, 50] = 3.0
    assert estimate_brightness(sensor.expose(scene, rng=0), sensor) < 0.25
    scene[20:40, 20:40] = 0.8
    assert estimate_brightness(sensor.expose(scene, rng=0), sensor) == pytest.approx(0.8, rel=0.1)


def test_a_capture_without_ones_has_a_positive_brightness():
    sensor, brightness = training_sensor(np.zeros((16, 16), int), jl.Sensor(frames=16))
    assert brightness > 0
    assert sensor.max_intensity == HEADROOM * brightness


@pytest.mark.parametrize(
    ("units", "expected"),
    [("intensity", 1.0), ("photons", 0.5 * 20 / 10), ("photons-per-second", 0.5 * 20 / 10 / 2e-5)],
)
def test_units_count_the_detected_photons_of_a_pixel(units, expected):
    sensor = jl.Sensor(oversampling=2, frames=10, gain=20, efficiency=0.5, exposure_time=2e-5)
    assert unit_scale(sensor, units) == pytest.approx(expected, rel=1e-12)
    # A second has 1 / exposure_time frames, whatever their number in the capture.
    assert unit_scale(sensor.replace(frames=40), units) == pytest.approx(expected, rel=1e-12)


def test_units_of_equivalent_counts_are_those_of_a_frame():
    sensor = jl.Sensor(frames=10, gain=20)
    each = [jl.Merged([[3]], 9.0, sensor, light_share=share) for share in (0.1, 0.1, 0.2)]
    assert unit_scale(sensor, "photons", each[0]) == pytest.approx(20)
    assert unit_scale(sensor, "photons", GrayImages(each[:2], Layout((2,)))) == pytest.approx(20)
    with pytest.raises(ValueError, match="because the frames have different gains"):
        unit_scale(sensor, "photons", GrayImages(each, Layout((3,))))


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ("photon", "units: expected one of intensity, photons, photons-per-second, got 'photon'"),
        ("photons-per-second", r"state it with Sensor\(exposure_time=1e-5\) \(--exposure-time"),
    ],
)
def test_units_that_are_unknown_or_need_an_exposure_time_are_refused(units, message):
    with pytest.raises(ValueError, match=message):
        unit_scale(jl.Sensor(), units)
