"""The counts of jots: their detections per frame, and the variance of these."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.calibration.jot_counts import JotCounts


def test_the_variance_of_detections_is_that_of_many_draws():
    rng = np.random.default_rng(7)
    for threshold, rate in ((1, 0.05), (1, 1.5), (3, 2.0)):
        chance = jl.Sensor(threshold=threshold).probability(np.full((1, 1), rate))
        ones = rng.binomial(2000, chance, (20_000, 1)).astype(np.int32)
        counts = JotCounts(ones, 2000, threshold)
        expected = counts.variance(np.array([rate]))[0]
        assert counts.detections().var() == pytest.approx(expected, rel=0.05)
