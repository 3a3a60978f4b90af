"""Intervals for readings that differ: exact coverage over the range of light."""

import numpy as np
import pytest
from scipy import stats

import jotlight as jl
from jotlight.estimators.readings.joint_uncertainty import find_zeros
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.likelihood.multibit import reading_probability
from jotlight.sensing.parameters.response import detection_probability

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


def test_pixels_with_different_readings_keep_the_coverage():
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


@pytest.mark.slow
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


def readings_of_all_totals(sensor):
    """Readings whose pixels in column L have the total L, as far as it is possible."""
    rows, side = (len(sensor.mask) // sensor.oversampling, sensor.oversampling)
    columns = sensor.mask.shape[1] // side
    live = ~sensor.mask.reshape(rows, side, columns, side)
    data = np.zeros((sensor.frames, *live.shape), int)
    rest = np.broadcast_to(np.arange(columns), (rows, columns)).copy()
    for frame, i, j in np.ndindex(sensor.frames, side, side):
        own = np.where(live[:, i, :, j], np.minimum(rest, sensor.max_reading), 0)
        data[frame, :, i, :, j], rest = own, rest - own
    flat = data.reshape(sensor.frames, *sensor.mask.shape)
    return jl.Readings(flat, sensor) if sensor.bit_depth > 1 else jl.Bits.from_array(flat, sensor)


def distribution_of_row(sensor, row, intensity):
    """The probabilities of the totals of the pixels of a row: a convolution, one by one."""
    side, levels = sensor.oversampling, np.arange(sensor.max_reading + 1)
    gains = np.broadcast_to(sensor.gain, sensor.frames)
    share = 1 / side**2 / (1 if np.ndim(sensor.gain) else sensor.frames)
    maps = [np.broadcast_to(m, sensor.mask.shape) for m in (sensor.efficiency, sensor.dark_counts)]
    result = np.ones(1)
    for gain in gains:
        for i, j in np.ndindex(side, side):
            place = row * side + i, j
            if not sensor.mask[place]:
                rate = maps[0][place] * gain * share * intensity + maps[1][place]
                options = {"bit_depth": sensor.bit_depth, "read_noise": sensor.read_noise}
                result = np.convolve(result, reading_probability(levels, rate, **options))
    return result


def with_maps(sensor, columns, **rows):
    """The sensor with maps whose rows of jots are given, repeated along all columns of pixels."""
    maps = {name: np.tile(np.array(values), (1, columns)) for name, values in rows.items()}
    own = {"mask": np.zeros_like(next(iter(maps.values())), bool), **maps}
    return sensor.replace(**own)


ONE_READING = jl.Sensor(frames=1, gain=1.0, bit_depth=8, max_intensity=100.0)
TWO_BITS = jl.Sensor(frames=2, gain=4.0, bit_depth=2, read_noise=0.3, max_intensity=30.0)
MAPS = {"efficiency": [[0.3], [0.5], [0.9]], "dark_counts": [[0.0], [0.2], [3.0]]}
PATTERN = {
    "efficiency": [[0.3, 0.9], [0.9, 0.5]] * 2,
    "mask": [[False, False]] * 3 + [[True, False]],
}
BITS = TWO_BITS.replace(bit_depth=1, frames=6, gain=[1.0, 5.0] * 3)
WITH_MAPS = {
    "mask": with_maps(ONE_READING, 256, mask=[[False], [True]]),
    "maps": with_maps(ONE_READING, 256, **MAPS),
    "a long total": with_maps(ONE_READING.replace(frames=9, gain=1.0), 160, **MAPS),
    "read noise": with_maps(TWO_BITS, 7, **MAPS),
    "bracket": with_maps(TWO_BITS.replace(gain=[1.0, 5.0]), 7, **MAPS),
    "bits": with_maps(BITS, 7, **MAPS),
    "many kinds of bits": with_maps(BITS, 7, dark_counts=np.geomspace(0.01, 2, 65)[:, None]),
    "jots that differ": with_maps(TWO_BITS.replace(oversampling=2), 25, **PATTERN),
}


@pytest.mark.filterwarnings("ignore:.*brighter than the largest intensity")
@pytest.mark.filterwarnings("ignore:.*no valid bit")
@pytest.mark.parametrize(
    "level", [0.99, *(pytest.param(level, marks=pytest.mark.slow) for level in (0.9, 0.9999))]
)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name == "many kinds of bits" else ())
        for name in WITH_MAPS
    ],
)
def test_the_coverage_reaches_the_confidence_level_with_masks_and_maps(name, level):
    sensor = WITH_MAPS[name]
    data = readings_of_all_totals(sensor)
    data.tested_for_periods = True
    result = jl.uncertainty(data, method="mle", confidence_level=level)
    estimate = jl.mle(data)
    assert ((result.low <= estimate) & (estimate <= result.high))[~result.dead].all()
    for row in np.flatnonzero(~result.dead.all(axis=1)):
        for intensity in [0.0, *np.geomspace(1e-2, 1, 25) * min(sensor.max_intensity, 40)]:
            distribution = distribution_of_row(sensor, row, intensity)
            known = min(len(distribution), result.low.shape[1])
            contains = (result.low[row] <= intensity) & (intensity <= result.high[row])
            missed = distribution[:known][~contains[:known]].sum() + distribution[known:].sum()
            assert missed <= 1 - level + 1e-9


@pytest.mark.filterwarnings("ignore:.*brighter than the largest intensity")
def test_intervals_with_a_mask_are_those_without_it():
    masked = readings_of_all_totals(WITH_MAPS["mask"])
    known = jl.uncertainty(masked, method="mle", confidence_level=0.99)
    alone = jl.Readings(np.asarray(masked)[:, :1], ONE_READING)
    expected = jl.uncertainty(alone, method="mle", confidence_level=0.99)
    np.testing.assert_array_equal(known.low[0], expected.low[0])
    np.testing.assert_array_equal(known.high[0], expected.high[0])
    # Poisson counts have an interval in closed form.
    totals = np.arange(1, 60)
    np.testing.assert_allclose(known.low[0, 1:60], stats.chi2.ppf(0.005, 2 * totals) / 2, rtol=1e-6)
    high = stats.chi2.ppf(0.995, 2 * totals + 2) / 2
    np.testing.assert_allclose(known.high[0, 1:60], high, rtol=1e-6)


@pytest.mark.filterwarnings("ignore:read_noise")
def test_the_ends_for_many_bits_and_read_noise_have_the_stated_tails():
    sensor = jl.Sensor(frames=2, gain=400.0, bit_depth=10, read_noise=2.0, max_intensity=4.0)
    totals = np.array([7, 60, 180, 500, 1000])
    readings = np.stack([totals // 3, totals - totals // 3])[:, None]
    result = jl.uncertainty(jl.Readings(readings, sensor), method="mle", confidence_level=0.9)

    def distribution(intensity):
        one = reading_probability(np.arange(1024), 200 * intensity, bit_depth=10, read_noise=2.0)
        return np.convolve(one, one)

    for total, low, high in zip(totals, result.low[0], result.high[0], strict=True):
        assert distribution(low)[total:].sum() == pytest.approx(0.05, rel=1e-4)
        assert distribution(high)[: total + 1].sum() == pytest.approx(0.05, rel=1e-4)


def test_a_zero_outside_of_the_range_has_its_end():
    targets = np.array([1e-300, 0.25, 7.0])
    low, high = find_zeros(lambda x, places: x - targets[places], 3, 2.0)
    np.testing.assert_allclose(low, [0, 0.25, 2], rtol=1e-8)
    assert 0 < high[0] < 1e-30
    np.testing.assert_allclose(high[1:], [0.25, 2], rtol=1e-8)
