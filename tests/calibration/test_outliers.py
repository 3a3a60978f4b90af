"""Tests of jotlight.calibration.outliers."""

import numpy as np
import pytest
from scipy.stats import binom, norm

import jotlight as jl
from jotlight.calibration.jot_counts import JotCounts
from jotlight.calibration.outliers import find_outliers


def _find(ones, frames, light, prnu, limit=4.0, threshold=1):
    flat = JotCounts(np.asarray(ones, np.int32), frames, threshold)
    lights = np.full(flat.ones.shape, light)
    noise = flat.variance(lights) / light**2
    relative = flat.detections() / light
    return find_outliers(flat, 0 * lights, lights, relative, noise, prnu, limit), relative, noise


@pytest.mark.parametrize(("frames", "light"), [(8, 0.4), (64, 1.5), (4000, 0.7)])
def test_without_prnu_outliers_are_those_of_the_binomial_tails(frames, light):
    ones = np.arange(frames)
    found, relative, noise = _find(ones, frames, light, 0.0)
    p = -np.expm1(-light)
    improbable = np.minimum(binom.sf(ones - 1, frames, p), binom.cdf(ones, frames, p)) < norm.sf(4)
    np.testing.assert_array_equal(found, improbable & ((relative - 1) ** 2 > 16 * noise))


def test_with_many_frames_outliers_are_those_of_the_normal_distribution_of_responses():
    relative = np.array([0.5, 0.79, 0.81, 1.0, 1.19, 1.21, 2.0])
    frames = 10**8
    found = _find(np.round(frames * -np.expm1(-0.5 * relative)), frames, 0.5, 0.05)[0]
    assert found.tolist() == [True, True, False, False, False, True, True]


def test_ordinary_jots_of_a_short_flat_capture_are_no_outliers():
    # The noise of their responses is skew: some seem to respond five times as strongly.
    rng = np.random.default_rng(0)
    relative = 1 + 0.02 * rng.standard_normal((96, 96))
    dark = rng.binomial(4000, -np.expm1(-0.01), relative.shape)
    flat = rng.binomial(8, -np.expm1(-0.01 - 0.4 * relative))
    calibration = jl.calibrate(dark, flat, frames=4000, flat_frames=8)
    response = calibration.efficiency * calibration.scale
    assert np.abs(response - relative)[~calibration.mask].max() < 0.15
