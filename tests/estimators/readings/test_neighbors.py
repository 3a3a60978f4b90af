"""What pixels have in common with their neighbors: the most likely light, and averages."""

import numpy as np
import pytest

from jotlight.estimators.readings.neighbors import (
    MAX_FILTERS,
    average_fractions,
    each_filter,
    fisher_scoring,
    own_sigma,
)
from jotlight.sensing.parameters.response import (
    detection_density,
    detection_probability,
    silence_probability,
)


def derivatives_of(fraction, trials, threshold):
    """Return the function from light to the derivative and the information of some bits."""

    def derivatives(light):
        p, zero = detection_probability(threshold, light), silence_probability(threshold, light)
        slope = detection_density(threshold, light)
        weight = trials * slope / (p * zero)
        return weight * (fraction - p), weight * slope

    return derivatives


@pytest.mark.parametrize("threshold", [1, 3])
def test_fisher_scoring_finds_the_most_likely_light(threshold):
    light = np.linspace(0.5, 3, 20)
    p = detection_probability(threshold, light)
    found = fisher_scoring(light * 1.2, derivatives_of(p, 16, threshold), 1e-6)
    np.testing.assert_allclose(found, light, rtol=1e-3)


def test_fisher_scoring_stays_within_its_limits():
    fraction = np.array([0.0, 0.5, 1.0])
    found = fisher_scoring(np.full(3, 0.7), derivatives_of(fraction, 8, 1), 0.2, 0.9)
    np.testing.assert_allclose(found, [0.2, np.log(2), 0.9], rtol=1e-3)


def test_averages_of_a_filter_leave_out_other_filters():
    pattern = np.indices((32, 48)).sum(axis=0) % 2
    ones = np.where(pattern == 0, 2.0, 7.0)
    found = average_fractions(ones, np.full(ones.shape, 8.0), 2.0, pattern)
    np.testing.assert_allclose(found, ones / 8, rtol=1e-6)


def test_averages_of_a_filter_have_as_many_of_its_pixels():
    pattern = np.indices((32, 48)).sum(axis=0) % 4
    for own in each_filter(pattern, pattern.shape):
        # A Gaussian filter weighs about 4 π σ² pixels.
        assert own_sigma(1.5, own) ** 2 * own.mean() == pytest.approx(1.5**2)
    none = np.zeros((4, 4), bool)
    assert own_sigma(1.0, none) == pytest.approx(MAX_FILTERS**0.5)


def test_averages_of_zeros_are_those_of_half_a_one():
    found = average_fractions(np.zeros((24, 24)), np.full((24, 24), 8.0), 2.0)
    np.testing.assert_allclose(found, 0.5 / (4 * np.pi * 2.0**2 * 8), rtol=1e-6)
    few = average_fractions(np.zeros((24, 24)), np.full((24, 24), 1e-4), 2.0)
    np.testing.assert_allclose(few, 0.5, rtol=1e-6)
