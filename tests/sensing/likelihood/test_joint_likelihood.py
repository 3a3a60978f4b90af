"""The likelihood of readings that differ: definitions with mpmath, and sums over all outcomes."""

import itertools

import mpmath
import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.parameters.reading_groups import group_readings

RANDOM = np.random.default_rng(2)


def probability(threshold, rate):
    """P(q, s) with mpmath."""
    return mpmath.gammainc(threshold, 0, rate, regularized=True)


def log_likelihood(bits, sensor, row, column, intensity):
    """The log-likelihood of a pixel, bit by bit, with 30 digits."""
    side, total = sensor.oversampling, mpmath.mpf(0)
    gains = np.broadcast_to(
        sensor.gain if np.ndim(sensor.gain) else sensor.gain / sensor.frames, sensor.frames
    )
    for frame, jot_row, jot_column in itertools.product(
        range(sensor.frames), range(side), range(side)
    ):
        place = row * side + jot_row, column * side + jot_column
        if sensor.mask is not None and sensor.mask[place]:
            continue
        efficiency, dark_counts, threshold = (
            value[place] if np.ndim(value) == 2 else value[frame] if np.ndim(value) else value
            for value in (sensor.efficiency, sensor.dark_counts, sensor.threshold)
        )
        light = mpmath.mpf(float(gains[frame])) / side**2 * intensity
        p = probability(int(threshold), float(efficiency) * light + float(dark_counts))
        total += mpmath.log(p if bits[frame, *place] else 1 - p)
    return total


SENSORS = [
    jl.Sensor(frames=4, gain=[0.2, 1.5, 8.0, 8.0], dark_counts=0.02),
    jl.Sensor(frames=4, gain=12.0, threshold=[1, 2, 6, 6], efficiency=0.6),
    jl.Sensor(frames=2, oversampling=2, gain=30.0, threshold=RANDOM.integers(1, 5, (4, 6))),
    jl.Sensor(
        frames=2,
        oversampling=2,
        gain=[3.0, 20.0],
        threshold=RANDOM.integers(1, 4, (4, 6)),
        efficiency=RANDOM.uniform(0.3, 1, (4, 6)),
        dark_counts=RANDOM.uniform(0, 0.2, (4, 6)),
        mask=RANDOM.random((4, 6)) < 0.2,
    ),
]


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_value_and_derivatives_agree_with_the_definition(sensor):
    shape = tuple(size // sensor.oversampling for size in (4, 6))
    intensity = RANDOM.uniform(0.1, 1.2, shape)
    bits = sensor.expose(intensity, rng=0)
    joint = joint_likelihood(bits, sensor, None)
    assert joint.shape == shape
    array = bits.to_array()
    with mpmath.workdps(30):
        pixels = list(np.ndindex(shape))
        expected = [log_likelihood(array, sensor, *place, intensity[place]) for place in pixels]
        assert joint.value(intensity) == pytest.approx(float(sum(expected)), rel=1e-10)
        gradient, curvature = joint.gradient_and_curvature(intensity)
        for place in pixels[:: max(1, len(pixels) // 3)]:

            def value(x, place=place):
                return log_likelihood(array, sensor, *place, x)

            first = float(mpmath.diff(value, intensity[place]))
            second = float(mpmath.diff(value, intensity[place], 2))
            assert gradient[place] == pytest.approx(first, rel=1e-8, abs=1e-8)
            assert -curvature[place] == pytest.approx(second, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("sensor", SENSORS[:2], ids=repr)
def test_the_information_is_the_mean_of_the_curvature_over_all_outcomes(sensor):
    intensity = 0.7
    outcomes = np.array(list(itertools.product([0, 1], repeat=4)), bool)
    # Each outcome is a column of pixels, so one image holds all of them.
    bits = jl.Bits.from_array(outcomes.T[:, None, :], sensor)
    joint = joint_likelihood(bits, sensor, None)
    p = sensor.probability(np.full((1, 1), intensity))[:, 0, 0].astype(float)
    weights = np.where(outcomes, p, 1 - p).prod(axis=1)
    gradient, curvature = joint.gradient_and_curvature(intensity)
    information = joint.information(intensity)[0]
    np.testing.assert_allclose(information, information[0])
    assert weights @ curvature[0] == pytest.approx(information[0], rel=1e-5)
    assert weights @ gradient[0] ** 2 == pytest.approx(information[0], rel=1e-5)
    assert weights @ gradient[0] == pytest.approx(0, abs=1e-5)


def test_counts_of_single_jots_suffice_if_only_their_thresholds_differ():
    threshold = np.where(np.indices((6, 8)).sum(axis=0) % 2, 1, 3)
    sensor = jl.Sensor(frames=9, gain=18.0, threshold=threshold)
    bits = sensor.expose(np.full((6, 8), 0.6), rng=0)
    one, other = joint_likelihood(bits, sensor, None), joint_likelihood(bits.counts(), sensor, None)
    assert one.value(0.5) == other.value(0.5)
    np.testing.assert_array_equal(one.trials, 9)
    np.testing.assert_array_equal(one.total, bits.counts())


def test_frames_are_read_from_files_in_parts(tmp_path, monkeypatch):
    sensor = jl.Sensor(frames=30, gain=[0.3, 2.0, 9.0] * 10)
    bits = sensor.expose(RANDOM.random((8, 16)), rng=0)
    jl.save(bits, tmp_path / "a.npy")
    monkeypatch.setattr("jotlight.sensing.bits.frames._MAX_BYTES", 100)
    opened = jl.open(tmp_path / "a.npy")
    ones = [term.cells.ones for term in joint_likelihood(opened, sensor, None).terms]
    array = bits.to_array()
    for group, counts in zip(group_readings(sensor), ones, strict=True):
        np.testing.assert_array_equal(counts, array[group.frames].sum(axis=0))


@pytest.mark.parametrize("sensor", [SENSORS[0], SENSORS[2]], ids=repr)
def test_counts_that_do_not_say_which_readings_are_1_are_refused(sensor):
    with pytest.raises(
        ValueError, match=r"counts: expected bits, because the readings .* the bits"
    ):
        jl.mle(np.ones((2, 3), int), sensor)
    merged = jl.Merged(np.ones((2, 3), int), 4, jl.Sensor(frames=4))
    with pytest.raises(TypeError, match="data: expected bits, because merged counts do not say"):
        jl.mle(merged, sensor)


def test_bits_of_other_frames_than_the_sensor_are_refused():
    bits = jl.Bits.from_array(np.ones((3, 4, 4), bool))
    with pytest.raises(ValueError, match="bits: expected the sensor's 4 frames, got 3"):
        jl.mle(bits, SENSORS[0])
