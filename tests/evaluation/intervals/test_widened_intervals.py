"""Intervals begin where the information of the readings says, not that of equivalent counts."""

import numpy as np
import pytest
from scipy.integrate import quad

import jotlight as jl
from jotlight.estimators.readings.reference_sensors import reference_sensor
from jotlight.evaluation.intervals.widened_intervals import widen_intervals

BRACKET = jl.Sensor(frames=8, threshold=8, gain=np.tile([2.0, 32.0], 4), max_intensity=3.0)


def intervals(low, high):
    flags = dict.fromkeys(("unlit", "saturated", "dead", "unlikely"), np.zeros(low.shape, bool))
    return jl.Uncertainty(high - low, low, high, **flags, confidence_level=0.95)


def information(sensor, x):
    """Return the information of all bits of a pixel about its intensity."""
    total = 0.0
    for group in sensor.groups():
        light, number = group.sensor.light_per_intensity, len(group.frames)
        one = jl.Likelihood(np.zeros(1, int), number, threshold=group.sensor.threshold)
        total += light**2 * one.information(np.array([light * x]))[0]
    return total


def test_lower_ends_are_as_many_standard_deviations_away_for_the_readings():
    estimate = np.float32([[0.5, 1.0, 1.5]])
    low, high = 0.8 * estimate, 1.2 * estimate
    found = widen_intervals(intervals(low, high), estimate, BRACKET)
    reference = reference_sensor(BRACKET)

    def length(sensor, start, stop):
        return quad(lambda x: information(sensor, x) ** 0.5, start, stop)[0]

    for place, x in enumerate(estimate[0]):
        trials = information(BRACKET, x) / information(reference, x)
        ends = float(low[0, place]), float(found.low[0, place])
        counts, readings = (
            length(sensor, end, x) for sensor, end in zip((reference, BRACKET), ends, strict=True)
        )
        assert ends[1] <= ends[0]
        if ends[1] < ends[0]:
            assert readings == pytest.approx(trials**0.5 * counts, rel=0.01)
    assert (found.low < low).any()
    np.testing.assert_array_equal(found.high, high)


def test_readings_that_tell_as_much_as_their_counts_keep_their_intervals():
    sensor = jl.Sensor(frames=16, threshold=[3, 3, 3, 4] * 4, gain=48.0, max_intensity=3.0)
    estimate = np.geomspace(0.2, 2, 9, dtype=np.float32).reshape(3, 3)
    low, high = 0.9 * estimate, 1.1 * estimate
    found = widen_intervals(intervals(low, high), estimate, sensor)
    np.testing.assert_allclose(found.low, low, rtol=0.01)
    np.testing.assert_allclose(found.high, high, rtol=0.01)
    assert not found.unlit.any()


@pytest.mark.parametrize("live", [2, 4])
def test_dead_jots_change_no_interval(live):
    """The trials of the counts have fewer readings, too."""
    estimate = np.geomspace(0.2, 2, 16, dtype=np.float32).reshape(4, 4)
    found = intervals(0.8 * estimate, 1.2 * estimate)
    sensor = BRACKET.replace(oversampling=2)
    masked = sensor.replace(mask=np.arange(64).reshape(8, 8) % live > 0)
    expected = widen_intervals(found, estimate, sensor).low
    assert (expected < found.low).any()
    np.testing.assert_allclose(widen_intervals(found, estimate, masked).low, expected, rtol=1e-5)


def test_a_lit_pixel_whose_interval_began_at_0_stays_lit():
    estimate = np.float32([[0.02, 0.02]])
    found = widen_intervals(intervals(np.float32([[0.0, 0.01]]), 2 * estimate), estimate, BRACKET)
    assert found.low.tolist() == [[0.0, 0.0]]
    assert found.unlit.tolist() == [[False, True]]


def test_intervals_of_darkness_below_all_thresholds_begin_at_0():
    bits = BRACKET.expose(np.full((48, 48), 0.02), rng=0)
    assert bits.to_array().sum() == 0
    found = jl.uncertainty(bits)
    assert (found.low == 0).all()
    assert found.unlit.all()
    assert (found.high >= 0.02).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"threshold": 8, "read_noise": 0.3},
        {"threshold": 16, "read_noise": 0.3},
        {"threshold": [15, 17] * 8},
        {"threshold": 8, "gain": np.tile([8.0, 32.0], 8)},
    ],
    ids=str,
)
def test_intervals_contain_dark_pixels_below_high_thresholds(options):
    """With counts of the threshold 1, 8 to 68 % of these intervals did."""
    image = jl.datasets.photograph("camera")[::2, ::2][32:160, 32:160].astype(float)
    gain = 24.0 * np.mean(options["threshold"])
    bits = jl.Sensor(**{"frames": 16, "gain": gain} | options).expose(image, rng=0)
    found = jl.uncertainty(bits)
    covers = (found.low <= image) & (image <= found.high)
    assert covers.mean() > 0.93
    assert covers[image < 0.15].mean() > 0.91
