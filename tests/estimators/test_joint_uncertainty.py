"""Intervals for readings that differ: exact coverage over the range of light."""

import numpy as np
import pytest
from scipy import stats

import jotlight as jl
from jotlight.estimators.joint_uncertainty import distribution_of_total
from jotlight.sensing.joint_likelihood import joint_likelihood
from jotlight.sensing.response import detection_probability

BRACKET = {"frames": 48, "gain": np.repeat([1 / 64, 1 / 8, 1.0], 16), "max_intensity": 2000.0}
SENSORS = [
    jl.Sensor(**BRACKET),
    jl.Sensor(**BRACKET, dark_counts=0.05, efficiency=0.7),
    jl.Sensor(frames=12, gain=24.0, threshold=[1, 3, 9] * 4, max_intensity=60.0),
]


def exact_distribution(sensor, intensity):
    """The probabilities of 0 to N ones of a pixel: a convolution, one reading at a time."""
    gains = np.broadcast_to(
        sensor.gain if np.ndim(sensor.gain) else sensor.gain / sensor.frames, sensor.frames
    )
    thresholds = np.broadcast_to(sensor.threshold, sensor.frames)
    result = np.ones(1)
    for gain, q in zip(gains, thresholds, strict=True):
        rate = sensor.efficiency * gain * intensity + sensor.dark_counts
        p = float(detection_probability(int(q), rate))
        result = np.convolve(result, [1 - p, p])
    return result


def all_totals(sensor):
    """Bits whose pixels have 0 to N ones. The interval depends on their number alone."""
    number = sensor.frames
    ones = np.arange(number)[:, None, None] < np.arange(number + 1)[None, None]
    return jl.Bits.from_array(ones, sensor)


def coverage(sensor, result, intensity):
    truth = np.float32(intensity)
    contains = (result.low[0] <= truth) & (truth <= result.high[0])
    return exact_distribution(sensor, intensity)[contains].sum()


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
@pytest.mark.parametrize(
    "level", [0.95, *(pytest.param(level, marks=pytest.mark.slow) for level in (0.5, 0.999))]
)
def test_the_coverage_reaches_the_confidence_level_throughout_the_range(sensor, level):
    result = jl.uncertainty(all_totals(sensor), method="mle", confidence_level=level)
    levels = [0.0, *np.geomspace(1e-5, 1, 60) * sensor.max_intensity]
    covered = [coverage(sensor, result, intensity) for intensity in levels]
    assert min(covered) >= level - 1e-6


def test_the_coverage_is_close_to_the_confidence_level_where_the_data_decide():
    sensor = SENSORS[0]
    result = jl.uncertainty(all_totals(sensor), method="mle")
    covered = [coverage(sensor, result, x) for x in np.geomspace(0.3, 100, 80)]
    assert np.mean(covered) < 0.985


def test_for_one_gain_and_threshold_the_interval_is_that_of_clopper_and_pearson():
    # The gains differ by less than their rounding to float32 can show.
    sensor = jl.Sensor(frames=20, gain=np.linspace(1 - 1e-9, 1 + 1e-9, 20), max_intensity=9.0)
    result = jl.uncertainty(all_totals(sensor), method="mle", confidence_level=0.9)
    for count in range(21):
        exact = stats.binomtest(count, 20).proportion_ci(0.9, method="exact")
        assert -np.expm1(-result.low[0, count]) == pytest.approx(exact.low, abs=1e-6)
        if count < 20:
            assert -np.expm1(-result.high[0, count]) == pytest.approx(exact.high, abs=1e-6)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_the_distribution_agrees_with_single_convolutions(sensor):
    terms = joint_likelihood(all_totals(sensor), sensor, None).terms
    levels = np.geomspace(1e-4, 1, 9) * sensor.max_intensity
    expected = [exact_distribution(sensor, level) for level in levels]
    np.testing.assert_allclose(distribution_of_total(terms, levels), expected, atol=1e-13)


def test_pixels_with_different_readings_have_wider_intervals_with_the_same_coverage():
    sensor = jl.Sensor(**BRACKET)
    bits = all_totals(sensor)
    mask = np.zeros((2, 49), bool)
    mask[1, 0] = True
    both = jl.Bits.from_array(bits.to_array().repeat(2, axis=1), sensor.replace(mask=mask))
    known, result = (jl.uncertainty(each, method="mle") for each in (bits, both))
    assert (result.low[0] <= known.low[0] * (1 + 1e-5)).all()
    assert (result.high[0] >= known.high[0] * (1 - 1e-5)).all()
    for intensity in np.geomspace(1e-3, 1000, 30):
        assert coverage(sensor, result, intensity) >= 0.95
    assert result.dead.sum() == 1
    assert (result.low[1, 0], result.high[1, 0]) == (0, 2000)


def test_more_readings_than_the_exact_distribution_takes_keep_the_coverage():
    sensor = jl.Sensor(frames=300, gain=np.repeat([0.1, 1.0, 10.0], 100), max_intensity=200.0)
    result = jl.uncertainty(all_totals(sensor), method="mle")
    for intensity in np.geomspace(1e-3, 100, 10):
        assert coverage(sensor, result, intensity) >= 0.95


def test_flags_and_errors_state_what_the_data_say():
    sensor = SENSORS[1]
    result = jl.uncertainty(all_totals(sensor), method="mle")
    estimate = jl.mle(all_totals(sensor))
    assert result.unlit[0, 0]
    assert result.saturated[0].tolist() == [False] * 48 + [True]
    assert result.high[0, -1] == 2000
    assert ((result.low <= estimate) & (estimate <= result.high)).all()
    assert np.isfinite(result.standard_error).all()
    joint = joint_likelihood(all_totals(sensor), sensor, None)
    error = 1 / np.sqrt(joint.information(estimate))
    np.testing.assert_allclose(result.standard_error[0, 20:40], error[0, 20:40], rtol=1e-5)


@pytest.mark.slow
def test_units_need_one_gain():
    with pytest.raises(ValueError, match='units: expected "intensity", because the frames have'):
        jl.uncertainty(all_totals(SENSORS[0]), method="mle", units="photons")
    thresholds = SENSORS[2]
    bits = jl.Bits.from_array(np.eye(12, dtype=bool)[:, :1, None], thresholds)
    result = jl.uncertainty(bits, method="mle", units="photons")
    plain = jl.uncertainty(bits, method="mle")
    np.testing.assert_allclose(result.low, 2 * plain.low)
