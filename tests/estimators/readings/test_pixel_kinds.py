"""Kinds of pixels, and the distributions of their totals."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.readings.pixel_kinds import MAX_KINDS, find_kinds
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.likelihood.multibit import reading_probability
from jotlight.sensing.parameters.response import detection_probability

BRACKET = jl.Sensor(frames=6, gain=[0.1, 1.0, 9.0] * 2, max_intensity=20.0)
THRESHOLDS = jl.Sensor(frames=6, gain=6.0, threshold=[1, 3, 9] * 2, dark_counts=0.1)


def kinds_of(sensor, shape=(4, 6)):
    data = sensor.expose(np.full(shape, 0.5), rng=0)
    return find_kinds(joint_likelihood(data, sensor, None))


def one_by_one(each):
    result = np.ones(1)
    for probabilities in each:
        result = np.convolve(result, probabilities)
    return result


@pytest.mark.parametrize("sensor", [BRACKET, THRESHOLDS], ids=repr)
def test_the_distribution_of_bits_is_a_convolution(sensor):
    (kind,) = kinds_of(sensor)
    assert kind.max_total == 6
    gains = np.broadcast_to(sensor.gain / (1 if np.ndim(sensor.gain) else 6), 6)
    thresholds = np.broadcast_to(sensor.threshold, 6)
    levels = np.geomspace(1e-4, 20, 9)
    for level, found in zip(levels, kind.distribution(levels, 7), strict=True):
        ones = [
            float(detection_probability(int(q), gain * level + sensor.dark_counts))
            for gain, q in zip(gains, thresholds, strict=True)
        ]
        np.testing.assert_allclose(found, one_by_one([1 - p, p] for p in ones), atol=1e-13)


@pytest.mark.parametrize("length", [3, 20, 50])
def test_a_part_of_the_distribution_of_readings_is_exact(length):
    (kind,) = kinds_of(jl.Sensor(frames=7, gain=14.0, bit_depth=3, read_noise=0.4))
    assert kind.max_total == 49
    one = reading_probability(np.arange(8), 3.0, bit_depth=3, read_noise=0.4)
    expected = one_by_one([one] * 7)[:length]
    np.testing.assert_allclose(kind.distribution(np.array([1.5]), length)[0], expected, atol=1e-13)


def test_the_level_of_a_pixel_states_its_rate():
    efficiency = np.linspace(0.2, 1, 24).reshape(4, 6)
    dark_counts = np.linspace(0, 2, 24).reshape(4, 6)
    sensor = jl.Sensor(
        frames=2, gain=6.0, bit_depth=3, efficiency=efficiency, dark_counts=dark_counts
    )
    (kind,) = kinds_of(sensor)
    level = kind.scale * 0.7 + kind.offset
    (cell,) = kind.cells
    rate = cell.efficiency * cell.term.light * level + cell.dark_counts
    np.testing.assert_allclose(rate, (efficiency * 3 * 0.7 + dark_counts).ravel(), rtol=1e-6)


def test_masks_and_thresholds_make_few_kinds_and_unequal_jots_many():
    random = np.random.default_rng(0)
    mask = np.zeros((8, 12), bool)
    mask[0, 0] = mask[2, 4] = mask[2, 5] = True
    mask[6:, 10:] = True
    sensor = jl.Sensor(oversampling=2, bit_depth=2, mask=mask)
    kinds = kinds_of(sensor)
    assert sorted(len(kind.pixels) for kind in kinds) == [1, 1, 21]
    assert sorted(kind.max_total for kind in kinds) == [6, 9, 12]
    threshold = np.tile([[1, 2], [2, 3]], (4, 6))
    assert len(kinds_of(jl.Sensor(threshold=threshold), (8, 12))) == 3
    maps = {"efficiency": random.uniform(0.5, 1, (20, 20))}
    assert len(kinds_of(jl.Sensor(bit_depth=2, gain=[1.0, 4.0], frames=2, **maps), (20, 20))) == 1
    assert MAX_KINDS < 10 * 10
    assert kinds_of(jl.Sensor(oversampling=2, bit_depth=2, **maps), (10, 10)) == []
