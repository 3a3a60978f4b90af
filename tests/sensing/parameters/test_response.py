"""P(q, s) and its inverse, above all those of the engine, against exact arithmetic and SciPy."""

import numpy as np
import pytest
from mpmath import mp
from scipy.special import gammaincinv

from jotlight._engine import detection_probability, inverse_detection_probability
from jotlight.sensing.parameters import response

THRESHOLDS = [1, 2, 3, 5, 20, 100]
RATES = [*np.geomspace(1e-12, 1e4, 49), 0.999, 1.0, 1.001, 19.999, 20.0, 20.001, 100.0]
UNDERFLOW = 1e-300


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_the_probability_is_the_incomplete_gamma_function_to_eleven_digits(threshold):
    with mp.workdps(40):
        for rate in RATES:
            exact = mp.gammainc(threshold, 0, mp.mpf(float(rate)), regularized=True)
            probability = detection_probability(threshold, rate)
            if exact < UNDERFLOW:
                assert 0 <= probability < UNDERFLOW
            else:
                assert abs(probability / exact - 1) < 1e-11, rate


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_the_probability_rises_from_0_to_1(threshold):
    assert detection_probability(threshold, 0.0) == 0
    assert detection_probability(threshold, np.inf) == 1
    probabilities = [detection_probability(threshold, rate) for rate in sorted(RATES)]
    assert all(np.diff(probabilities) >= -1e-15)
    assert max(probabilities) <= 1


PROBABILITIES = [*np.geomspace(1e-290, 0.5, 59), *(1 - np.geomspace(1e-15, 0.5, 20))]


@pytest.mark.parametrize("threshold", [*THRESHOLDS, 1000])
def test_both_tails_at_the_inverse_are_right_to_eleven_digits(threshold):
    with mp.workdps(40):
        for probability in PROBABILITIES:
            rate = mp.mpf(inverse_detection_probability(threshold, probability))
            tails = mp.mpf(float(probability)), 1 - mp.mpf(float(probability))
            exact = mp.gammainc(threshold, 0, rate, regularized=True)
            assert abs(exact - tails[0]) < 1e-11 * min(tails), probability


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_the_inverse_agrees_with_scipy(threshold):
    probabilities = np.linspace(0.001, 0.999, 999)
    rates = [inverse_detection_probability(threshold, probability) for probability in probabilities]
    np.testing.assert_allclose(rates, gammaincinv(threshold, probabilities), rtol=1e-11)


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_the_inverse_undoes_the_probability(threshold):
    for rate in RATES:
        probability = detection_probability(threshold, rate)
        if UNDERFLOW < probability < 0.999:
            assert inverse_detection_probability(threshold, probability) == pytest.approx(
                rate, rel=1e-11
            )


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_the_inverse_of_0_and_1_is_0_and_infinity(threshold):
    assert inverse_detection_probability(threshold, 0.0) == 0
    assert inverse_detection_probability(threshold, 1.0) == np.inf
    assert inverse_detection_probability(threshold, -1e-9) == 0
    assert inverse_detection_probability(threshold, 1.1) == np.inf


@pytest.mark.parametrize("function", [detection_probability, inverse_detection_probability])
def test_a_threshold_of_0_is_refused(function):
    with pytest.raises(ValueError, match="threshold: expected 1 to 65535 photons, got 0"):
        function(0, 0.5)


@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("slope", [0.4, np.array([0.1, 1.0, 3.0])])
def test_the_intensity_of_a_probability_is_that_of_the_rate(threshold, slope):
    intensity = np.array([0.0, 0.3, 2.0])
    rate = slope * intensity + 0.2
    p = response.detection_probability(threshold, rate)
    zero = response.silence_probability(threshold, rate)
    found = response.intensity_at_probability(threshold, p, zero, slope, 0.2)
    np.testing.assert_allclose(found, intensity, rtol=1e-9, atol=1e-9)
    dark = response.intensity_at_probability(threshold, 0 * p, 1, slope, 0.2)
    np.testing.assert_allclose(dark, np.broadcast_to(-0.2 / slope, dark.shape))
