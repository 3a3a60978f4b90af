"""PRNU: it is the standard deviation of the true response, and the stated error holds."""

import numpy as np
import pytest
from scipy.stats import chi2

import jotlight as jl
from jotlight.calibration.prnu import _from_counts

SHAPE = (128, 128)
SEEDS = 6


def found(seed, spread, ones, frames, *, dark=0.002, dark_frames=4000, threshold=1, falloff=0.0):
    """Return PRNU and its error for flat captures with a share of ones in the middle."""
    rng = np.random.default_rng(seed)
    sensor = jl.Sensor(threshold=threshold)
    lights = np.linspace(0, 20, 20_001)[:, None]
    light = np.interp(ones, sensor.probability(lights)[:, 0], lights[:, 0])
    y, x = np.mgrid[-1 : 1 : SHAPE[0] * 1j, -1 : 1 : SHAPE[1] * 1j]
    light = light * (1 - falloff * (x**2 + y**2) / 2)
    response = 1 + spread * rng.standard_normal(SHAPE)
    calibration = jl.calibrate(
        rng.binomial(dark_frames, sensor.probability(np.full(SHAPE, dark))),
        rng.binomial(frames, sensor.probability(dark + light * response)),
        frames=dark_frames,
        flat_frames=frames,
        threshold=threshold,
    )
    return calibration.prnu, calibration.prnu_error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spread", "ones", "frames", "options"),
    [
        (0.0, 0.95, 200, {}),
        pytest.param(0.03, 0.95, 200, {}, marks=pytest.mark.exhaustive),
        pytest.param(0.01, 0.95, 200, {}, marks=pytest.mark.exhaustive),
        (0.1, 0.95, 200, {}),
        pytest.param(0.1, 0.99, 200, {}, marks=pytest.mark.exhaustive),
        pytest.param(0.0, 0.05, 200, {}, marks=pytest.mark.exhaustive),
        (0.1, 0.05, 200, {}),
        pytest.param(0.0, 0.5, 4000, {}, marks=pytest.mark.exhaustive),
        (0.01, 0.5, 4000, {}),
        pytest.param(0.1, 0.5, 4000, {}, marks=pytest.mark.exhaustive),
        pytest.param(0.0, 0.95, 4000, {"falloff": 0.5}, marks=pytest.mark.exhaustive),
        (0.01, 0.95, 4000, {"falloff": 0.5}),
        (0.1, 0.5, 1000, {"dark": 0.1, "dark_frames": 50}),
        pytest.param(
            0.0, 0.9, 1000, {"dark": 0.1, "dark_frames": 50}, marks=pytest.mark.exhaustive
        ),
        pytest.param(0.0, 0.95, 200, {"threshold": 2}, marks=pytest.mark.exhaustive),
        (0.1, 0.95, 200, {"threshold": 2}),
        pytest.param(0.03, 0.05, 200, {"threshold": 2}, marks=pytest.mark.exhaustive),
    ],
)
def test_prnu_is_found_within_its_error(spread, ones, frames, options):
    results = np.array([found(seed, spread, ones, frames, **options) for seed in range(SEEDS)])
    deviations = (results[:, 0] - spread) / results[:, 1]
    # Six normal deviations have a larger sum of squares with a chance of 1e-4.
    assert (deviations**2).sum() < chi2.isf(1e-4, SEEDS)
    assert abs(deviations.mean()) < 2.5
    # The error is not larger than the deviations suggest.
    assert np.mean(results[:, 1]) < 2 * np.std(results[:, 0]) + 4e-3 + 0.02 * spread


@pytest.mark.parametrize("fraction", [0.4, 0.7])
def test_one_flat_frame_is_refused(fraction):
    rng = np.random.default_rng(2)
    dark = rng.binomial(1000, 0.01, (32, 32))
    with pytest.raises(ValueError, match=r"flat: expected 2 frames or more.* record more frames"):
        jl.calibrate(dark, rng.binomial(1, fraction, (32, 32)), frames=1000, flat_frames=1)


@pytest.mark.parametrize(("response", "light"), [(0.2, 4.0), (0.15, 6.0)])
def test_the_spread_of_bright_counts_becomes_that_of_the_response(response, light):
    # The probability of a zero, exp(-light · r), is log-normal.
    variance = (light * response) ** 2
    usual = light - variance / 2
    spread = np.sqrt(np.expm1(variance)) / usual
    assert _from_counts(spread, usual, 0.0, 1) == pytest.approx(response, rel=0.02)


@pytest.mark.slow
def test_spreads_that_no_response_explains_are_limited():
    for light in np.geomspace(0.01, 60, 12):
        for spread in (1e-6, 0.1, 0.4, 0.99):
            assert 0 < _from_counts(spread, light, 0.01, 5) <= 1
