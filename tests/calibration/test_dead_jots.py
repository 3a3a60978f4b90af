"""Dead jots: the false-positive rate holds for any dark capture, and dead jots are found."""

import numpy as np
import pytest
from scipy.stats import binom

import jotlight as jl
from jotlight.calibration.dead_jots import MIN_RESPONSE, find_dead_jots
from jotlight.calibration.jot_counts import JotCounts
from jotlight.calibration.light import LocalLight

RATE = 1e-3


def probability(threshold, rate):
    return jl.Sensor(threshold=threshold).probability(np.full((1, 1), float(rate)))[0, 0]


@pytest.mark.parametrize("response", [MIN_RESPONSE, 1, 1 / MIN_RESPONSE])
@pytest.mark.parametrize(
    ("dark", "dark_frames", "light", "frames", "threshold"),
    [
        (0.1, 50, 0.1, 120, 1),
        (0.1, 4, 0.1, 120, 1),
        (1.5, 20, 0.3, 100, 1),
        (0.02, 1, 0.5, 60, 1),
        (0.01, 200, 0.7, 150, 1),
        (0.3, 30, 1.0, 150, 2),
    ],
)
def test_working_jots_are_called_dead_at_the_stated_rate_at_most(
    dark, dark_frames, light, frames, threshold, response
):
    # All pairs of counts, each with its probability: nothing is drawn or approximated.
    dark_ones, ones = np.mgrid[: dark_frames + 1, : frames + 1].astype(np.int32)
    full = np.full(ones.shape, light)
    found = LocalLight(full, full, 0 * full, 0 * full, full, 225 + 0 * full)
    counts = JotCounts(ones, frames, threshold), JotCounts(dark_ones, dark_frames, threshold)
    dead = find_dead_jots(*counts, found, RATE)
    chance = binom.pmf(dark_ones, dark_frames, probability(threshold, dark)) * binom.pmf(
        ones, frames, probability(threshold, dark + response * light)
    )
    assert chance.sum() == pytest.approx(1)
    assert chance[dead].sum() <= RATE


@pytest.mark.parametrize(
    ("dark", "dark_frames", "light"),
    [(0.1, 50, 0.1)]
    + [
        pytest.param(*case, marks=pytest.mark.slow)
        for case in (
            (0.1, 4, 0.1),
            (0.1, 4, 0.7),
            (0.5, 50, 0.3),
            (1.5, 200, 0.3),
            (0.1, 200, 0.05),
        )
    ],
)
@pytest.mark.filterwarnings("ignore:dark. no jot is called hot")
def test_a_short_dark_capture_makes_no_jots_dead(dark, dark_frames, light):
    rng = np.random.default_rng(0)
    shape = (128, 128)
    ones = rng.binomial(dark_frames, -np.expm1(-dark), shape)
    flat = rng.binomial(1000, -np.expm1(-dark - light), shape)
    calibration = jl.calibrate(ones, flat, frames=dark_frames, flat_frames=1000)
    # So many or more have a chance of 1e-3 at the stated rate of 1e-4.
    assert calibration.dead.sum() <= binom.isf(1e-3, flat.size, 1e-4)


@pytest.mark.parametrize(
    ("dark", "dark_frames", "light"), [(0.002, 4000, 0.7), (0.1, 4000, 0.7), (0.1, 50, 3.0)]
)
def test_jots_without_response_and_stuck_jots_are_dead(dark, dark_frames, light):
    rng = np.random.default_rng(1)
    shape = (96, 96)
    response = np.ones(shape)
    response[20:24, 30:34], response[60, ::7] = 0, 0
    ones = rng.binomial(dark_frames, -np.expm1(-dark), shape)
    flat = rng.binomial(1000, -np.expm1(-dark - light * response))
    expected = response == 0
    if light < 1:  # five times the brighter light fills all bits, too
        flat[80, 80], expected[80, 80] = 1000, True
    calibration = jl.calibrate(ones, flat, frames=dark_frames, flat_frames=1000)
    np.testing.assert_array_equal(calibration.dead, expected)
