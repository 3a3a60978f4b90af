"""How the ones of a frame depend on its light."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.counts.reading_response import Response
from jotlight.sensing.likelihood.multibit import reading_probability
from jotlight.sensing.parameters.response import detection_probability

SENSORS = [
    jl.Sensor(bit_depth=2),
    jl.Sensor(bit_depth=4, read_noise=0.3),
    jl.Sensor(read_noise=0.4),
    jl.Sensor(threshold=3),
]


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_the_response_is_that_of_direct_sums(sensor):
    several = sensor.bit_depth > 1
    n, readings = 31 if several else 1, np.arange(sensor.max_reading + 1)
    ones = n * (1 - (1 - 1 / n) ** readings) if several else readings.astype(float)
    bright = 3 if several else None
    table = Response.of(sensor, sensor.threshold, n, ones, bright)
    low = np.floor(ones)
    share = ones - low
    options = {"bit_depth": sensor.bit_depth, "read_noise": sensor.read_noise}
    for index in (0, 100, 400):
        rate = table.rates[index]
        probability = reading_probability(readings, rate, threshold=sensor.threshold, **options)
        mean = probability @ ((1 - share) * low + share * (low + 1))
        square = probability @ ((1 - share) * low**2 + share * (low + 1) ** 2)
        assert table.mean[index] == pytest.approx(mean / n, rel=1e-6, abs=1e-12)
        assert table.variance[index] == pytest.approx((square - mean**2) / n**2, rel=1e-6, abs=1e-9)


def test_between_the_rates_of_the_table_the_response_is_interpolated():
    table = Response.of(jl.Sensor(threshold=3), 3, 1, np.array([0.0, 1.0]), None)
    rates = np.array([0.013, 0.4, 3.3, 9.0, 500.0])
    mean, variance, slope = table.at(rates)
    expected = detection_probability(3, rates)
    np.testing.assert_allclose(mean, expected, atol=1e-5)
    np.testing.assert_allclose(variance, expected * (1 - expected), atol=1e-5)
    step = 1e-4
    above, below = (detection_probability(3, rates + sign * step) for sign in (1, -1))
    np.testing.assert_allclose(slope, (above - below) / (2 * step), atol=1e-3)
