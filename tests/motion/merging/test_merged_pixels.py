"""Sums over jots as merged counts: the efficiency and the dark counts of their pixels."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.counts.jots import Jots, SeenJots
from jotlight.motion.counts.sums import Sums
from jotlight.motion.merging.merged_pixels import as_fine, as_merged, as_pixels
from jotlight.motion.posterior import posterior_error
from moving import constant_motion

PIXELS, FRAMES, LIGHT = (24, 32), 100, 0.5
JOTS = 2 * PIXELS[0], 2 * PIXELS[1]


def sensor_with(dark_counts, efficiency=1.0, threshold=1):
    """Return a sensor whose pixels of 2 x 2 jots are all alike. A jot sees one photon at 1."""
    dark_counts, efficiency = (
        np.tile(np.broadcast_to(each, (2, 2)), PIXELS) for each in (dark_counts, efficiency)
    )
    return jl.Sensor(
        oversampling=2,
        frames=FRAMES,
        gain=4.0 * FRAMES * threshold,
        threshold=threshold,
        dark_counts=dark_counts,
        efficiency=efficiency,
    )


def sums_at_rest(sensor, trials):
    """Return sums, without ones, of a sensor whose jots stand still."""
    sums = Sums.zeros(JOTS)
    sums.trials = trials.astype(np.int32)
    sums.jots = Jots.of_sensor(sensor, JOTS, None).at_rest(sums.trials)
    return sums


def test_a_hot_jot_in_each_pixel_makes_no_bias():
    sensor = sensor_with([[2.0, 0.0], [0.0, 0.0]])
    bits = sensor.expose(np.full(PIXELS, LIGHT), rng=0)
    merged = jl.merge(bits, motion=jl.align(bits, model="none"))
    assert merged.shape == PIXELS
    # The mean of 768 pixels has a standard error of 0.2 %.
    assert jl.mle(merged).mean() == pytest.approx(LIGHT, rel=0.015)
    assert jl.mle(bits).mean() == pytest.approx(LIGHT, rel=0.015)


def test_with_the_dark_counts_of_a_pixel_as_many_bits_are_zeros():
    """Sums over the jots one by one, for jots with different numbers of bits."""
    rng = np.random.default_rng(0)
    dark = rng.uniform(0, 2, JOTS).astype(np.float32)
    sensor = sensor_with(0.0).replace(dark_counts=dark, efficiency=0.8)
    trials = rng.integers(0, 9, JOTS)
    trials[:2, :2] = 0
    found = np.asarray(as_pixels([sums_at_rest(sensor, trials)], sensor).dark_counts)
    assert found[0, 0] == np.float32(np.median(dark))  # without bits, those of the reference jot
    for row, column in np.ndindex(*PIXELS):
        own = np.s_[2 * row : 2 * row + 2, 2 * column : 2 * column + 2]
        zeros = (trials[own] * np.exp(-dark[own].astype(float))).sum()
        if trials[own].any():
            expected = -np.log(zeros / trials[own].sum())
            assert found[row, column] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("threshold", [1, 2])
def test_efficiencies_and_dark_counts_above_threshold_1_have_plain_means(threshold):
    rng = np.random.default_rng(1)
    maps = {"dark_counts": rng.uniform(0, 2, JOTS), "efficiency": rng.uniform(0.3, 1, JOTS)}
    sensor = sensor_with(0.0, threshold=threshold).replace(**maps)
    trials = rng.integers(1, 9, JOTS)
    merged = as_pixels([sums_at_rest(sensor, trials)], sensor)
    total = trials.reshape(PIXELS[0], 2, PIXELS[1], 2).sum(axis=(1, 3))
    # With threshold 1, the dark counts have another mean: see the test above.
    for name in ["efficiency", "dark_counts"][:threshold]:
        values = trials * maps[name]
        of_bits = values.reshape(PIXELS[0], 2, PIXELS[1], 2).sum(axis=(1, 3))
        np.testing.assert_allclose(getattr(merged, name), of_bits / total, atol=1e-5)


@pytest.mark.parametrize("as_counts", [as_merged, as_fine])
def test_efficiencies_that_rounding_makes_exceed_1_are_1(as_counts):
    efficiency = np.ones(JOTS)
    efficiency[:, : JOTS[1] // 2] = 0.9
    sensor = jl.Sensor(frames=7, efficiency=efficiency)
    sums = sums_at_rest(sensor, np.full(JOTS, 7))
    largest = np.nextafter(np.float32(7), np.float32(8))
    sums.jots = SeenJots(sums.jots.jots, np.where(sums.jots.sums == 7, largest, sums.jots.sums))
    assert sums.jots.mean(sums.trials)[0].max() > 1
    motion = constant_motion([(0, 0), (0, 0)], JOTS, [0, 6], 3)
    accepted, flags = np.ones(JOTS, np.float32), np.zeros(JOTS, bool)
    if as_counts is as_fine:
        motion = constant_motion([(0, 0), (0, 0)], PIXELS, [0, 6], 3)
        accepted, flags = np.ones(PIXELS, np.float32), np.zeros(PIXELS, bool)
    merged = as_counts([sums], accepted, flags, motion, sensor)
    assert np.asarray(merged.efficiency).max() == 1


def test_maps_of_jots_that_are_pixels_stay_as_they_are():
    size = 32, 48
    accepted = np.random.default_rng(0).random(size, np.float32)
    flags = accepted < 0.3
    motion = constant_motion([[0, 0], [1, 2]], size, [0, 7], 0)
    merged = as_merged([Sums.zeros(size)], accepted, flags, motion, jl.Sensor(frames=8))
    assert merged.acceptance.dtype == merged.posterior_error.dtype == np.float32
    np.testing.assert_array_equal(merged.acceptance, accepted)
    np.testing.assert_array_equal(merged.flags, flags)
    np.testing.assert_array_equal(merged.posterior_error, posterior_error(motion))
