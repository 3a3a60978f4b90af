"""Readings of several bits and read noise: probabilities, derivatives, and information."""

import mpmath as mp
import numpy as np
import pytest
from scipy import stats

from jotlight import _engine as engine
from jotlight.sensing.likelihood.multibit import (
    ReadingLikelihood,
    reading_distribution,
    reading_probability,
)
from jotlight.sensing.parameters.response import JotResponse
from reference import multibit

RESPONSES = [
    (4, 0.3, 1),
    (2, 0.15, 1),
    (3, 0.5, 1),
    (2, 0.0, 1),
    (4, 2.0, 1),
    (1, 0.3, 1),
    (1, 0.25, 4),
    (8, 0.3, 1),
]
"""Bit depth, read noise, and threshold."""

RATES = [1e-6, 0.01, 0.3, 1.0, 4.7, 30.0]


def some_readings(bit_depth):
    return sorted({0, 1, 2 ** (bit_depth - 1), 2**bit_depth - 2, 2**bit_depth - 1})


def cells(response, reading):
    bit_depth, noise, threshold = response
    sample = np.array([[reading]], np.int32)
    return ReadingLikelihood(JotResponse(2**bit_depth - 1, noise, threshold), sample, False)


def kinds_of_readings():
    """Yield all products. The fast ones have each response at every second rate."""
    for i, response in enumerate(RESPONSES):
        for j, rate in enumerate(RATES):
            marks = [] if (i + j) % 2 == 0 else [pytest.mark.slow]
            yield pytest.param(response, rate, marks=marks)


@pytest.mark.parametrize(("response", "rate"), list(kinds_of_readings()))
def test_probabilities_agree_with_mpmath(response, rate):
    bit_depth, noise, threshold = response
    for reading in some_readings(bit_depth):
        expected = multibit.reading_probability(reading, rate, bit_depth, noise, threshold)
        own = reading_probability(
            reading, rate, bit_depth=bit_depth, read_noise=noise, threshold=threshold
        )
        assert abs(float(own) - expected) <= 1e-10 * expected or expected < 1e-300


@pytest.mark.parametrize("response", [*RESPONSES, (10, 2.0, 1), (10, 30.0, 1), (12, 0.0, 1)])
@pytest.mark.parametrize("length", [1, 3, 200])
def test_the_distribution_has_the_probabilities_of_all_readings(response, length):
    bit_depth, noise, threshold = response
    options = {"bit_depth": bit_depth, "read_noise": noise, "threshold": threshold}
    rates = np.array([0.0, 1e-9, 0.3, 4.7, 30.0, 190.0, 900.0, 1e6, np.inf])
    readings = np.arange(min(length, 2**bit_depth))
    expected = np.zeros((len(rates), length))
    expected[:, : len(readings)] = reading_probability(readings, rates[:, None], **options)
    own = JotResponse(2**bit_depth - 1, noise, threshold)
    found = reading_distribution(own, rates, length, threads=1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("response", RESPONSES)
def test_probabilities_sum_to_one(response):
    bit_depth, noise, threshold = response
    options = {"bit_depth": bit_depth, "read_noise": noise, "threshold": threshold}
    all_readings = np.arange(2**bit_depth)
    rates = np.array([0.0, 1e-9, 0.2, 3.0, 40.0, 900.0])
    total = reading_probability(all_readings, rates[:, None], **options).sum(axis=1)
    np.testing.assert_allclose(total, 1, rtol=1e-12)


@pytest.mark.parametrize("response", RESPONSES[:2] + RESPONSES[3:7])
@pytest.mark.parametrize("rate", [0.01, 1.0, 4.7])
def test_derivatives_agree_with_those_of_mpmath(response, rate):
    for reading in some_readings(response[0]):

        def value(s, reading=reading):
            return mp.log(multibit.reading_probability(reading, s, *response))

        with mp.workdps(50):
            s, step = mp.mpf(rate), mp.mpf(rate) * mp.mpf("1e-12")
            low, middle, high = value(s - step), value(s), value(s + step)
            slope, fall = (high - low) / (2 * step), (high - 2 * middle + low) / step**2
        gradient, curvature = cells(response, reading).gradient_and_curvature([rate])
        assert gradient[0] == pytest.approx(float(slope), rel=1e-9, abs=1e-12)
        assert curvature[0] == pytest.approx(float(-fall), rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("response", [*RESPONSES, (16, 0.3, 1), (12, 0.0, 1)])
def test_the_information_is_the_mean_of_the_curvature_and_of_the_squared_slope(response):
    bit_depth, noise, threshold = response
    readings = np.arange(min(2**bit_depth, 6000))
    none = np.zeros((1, 0), np.int32)
    jot = ReadingLikelihood(JotResponse(2**bit_depth - 1, noise, threshold), none, False)
    for rate in (1e-6, 0.1, 4.7, 300.0):
        weights = jot.probability(readings, np.array([rate]))
        each = ReadingLikelihood(jot.response, readings[:, None].astype(np.int32), False)
        gradient, curvature = each.gradient_and_curvature(np.full(len(readings), rate))
        information = jot.information_per_reading(np.array([rate]))[0]
        assert information == pytest.approx(weights @ gradient**2, rel=1e-9, abs=1e-30)
        assert information == pytest.approx(weights @ curvature, rel=1e-6, abs=1e-30)


@pytest.mark.parametrize("response", [*RESPONSES, (16, 0.3, 1)])
def test_moments_are_those_of_the_distribution(response):
    bit_depth, _noise, _threshold = response
    jot = cells(response, 0)
    readings, step = np.arange(min(2**bit_depth, 6000)), 1e-5
    for rate in (0.0, 0.1, 4.7, 300.0):
        weights = jot.probability(readings, np.array([rate]))
        mean, variance, slope = (value[0] for value in jot.moments(np.array([rate])))
        assert mean == pytest.approx(weights @ readings, rel=1e-10)
        assert variance == pytest.approx(weights @ (readings - mean) ** 2, rel=1e-8, abs=1e-12)
        above = jot.moments(np.array([rate + step]))[0][0]
        assert slope == pytest.approx((above - mean) / step, abs=1e-4)


def test_histograms_and_lists_of_readings_say_the_same():
    rng = np.random.default_rng(0)
    readings = rng.integers(-1, 16, (5, 7, 30)).astype(np.int32)
    histograms = np.stack([(readings == value).sum(axis=-1) for value in range(16)], axis=-1)
    light, efficiency = rng.uniform(0.1, 20, (5, 7)), rng.uniform(0.3, 1, (5, 7))
    each = [
        ReadingLikelihood(JotResponse(15, 0.3, 1), sample.astype(np.int32), kind, efficiency, 0.2)
        for sample, kind in ((readings, False), (histograms, True))
    ]
    np.testing.assert_allclose(each[0].value(light), each[1].value(light), rtol=1e-12)
    for first, second in zip(*(one.gradient_and_curvature(light) for one in each), strict=True):
        np.testing.assert_allclose(first, second, rtol=1e-11)
    np.testing.assert_array_equal(each[0].total, each[1].total)
    np.testing.assert_array_equal(each[0].trials, each[1].trials)
    value = sum(
        np.log(
            reading_probability(
                r, efficiency[0, 0] * light[0, 0] + 0.2, bit_depth=4, read_noise=0.3
            )
        )
        for r in readings[0, 0]
        if r >= 0
    )
    one = ReadingLikelihood(
        JotResponse(15, 0.3, 1), readings[:1, :1], False, efficiency[:1, :1], 0.2
    )
    assert one.value(light[:1, :1]) == pytest.approx(value, rel=1e-12)


def test_a_reading_far_from_the_light_has_a_finite_slope():
    gradient, curvature = cells((4, 0.15, 1), 12).gradient_and_curvature([1e-90])
    assert np.isfinite(gradient[0])
    assert gradient[0] > 0
    assert np.isfinite(curvature[0])
    gradient, _ = cells((2, 0.3, 1), 0).gradient_and_curvature([1e6])
    assert gradient[0] == pytest.approx(-1, abs=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"reading": 4, "bit_depth": 2}, "expected whole numbers from 0 to 3"),
        ({"reading": 0.5}, "expected whole numbers from 0 to 1"),
        ({"reading": 0, "rate": -1.0}, "rate: expected numbers of 0 or more"),
        ({"reading": 0, "read_noise": -0.1}, "read noise: expected 0, or 0.001 to 100"),
        ({"reading": 0, "threshold": 0}, "threshold: expected 1 to 65535"),
    ],
)
def test_bad_input_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        reading_probability(**{"rate": 1.0, **arguments})


@pytest.mark.parametrize("top", [3, 255, 4095])
def test_the_information_of_clipped_counts_is_its_closed_form(top):
    rates = np.concatenate([np.geomspace(1e-8, 1, 40), np.geomspace(1, top + 6 * top**0.5, 60)])
    found = np.empty(rates.size)
    engine.readings_information((top, 0.0, 1), rates, found, None)
    below, last, before, clipped = (
        stats.poisson.cdf(top - 2, rates),
        stats.poisson.pmf(top - 1, rates),
        stats.poisson.pmf(top - 2, rates),
        stats.poisson.sf(top - 1, rates),
    )
    of_clipped = np.divide(last**2, clipped, out=np.zeros_like(rates), where=clipped > 0)
    np.testing.assert_allclose(found, below / rates + last - before + of_clipped, rtol=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_at_an_infinite_rate_all_readings_are_the_largest_one(noise):
    probability = reading_probability([0, 1, 2, 3], np.inf, bit_depth=2, read_noise=noise)
    assert probability.tolist() == [0, 0, 0, 1]


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_light_that_is_no_number_or_infinite_has_values(noise):
    likelihood = cells((2, noise, 1), 1)
    assert np.isnan(likelihood.value([np.nan]))
    assert np.isnan(likelihood.gradient_and_curvature([np.nan])).all()
    assert likelihood.value([np.inf]) == -np.inf
    assert np.array(likelihood.gradient_and_curvature([np.inf])).tolist() == [[-1], [0]]


def test_read_noise_that_changes_no_reading_is_refused():
    with pytest.raises(ValueError, match=r"read noise: expected 0, or 0.001 to 100, got 0\.00"):
        reading_probability(0, 1.0, read_noise=1e-200)
