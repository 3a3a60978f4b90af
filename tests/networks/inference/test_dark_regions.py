"""Dark regions: a twin in SciPy, the mean of the bits, and the true image are the oracles."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.special import gamma, gammaincinv

import jotlight as jl
from jotlight.metrics import psnr
from jotlight.networks.inference.dark_regions import match_dark_regions, may_have_dark_regions
from reference import dim_scenes as twin


def photograph():
    return jl.datasets.photograph("camera")[60:252:2, 160:352:2].astype(float)


def window(values):
    return gaussian_filter(values, 8.0, mode="reflect", truncate=4)


@pytest.mark.parametrize("threshold", [1, 2, 8])
@pytest.mark.parametrize("trials", [30, np.geomspace(4, 64, 48 * 40).reshape(48, 40)])
def test_probabilities_are_those_of_the_twin(trials, threshold):
    rng = np.random.default_rng(0)
    p = rng.choice([1e-4, 1e-3, 1e-2, 0.2], (48, 40))
    fraction = rng.poisson(0.3 * trials * p) / trials
    empty = 1 / (1 + (p / 5e-4) ** 2)
    smooth = p + empty * (window(empty * trials * p) / window(empty * trials) - p)
    dark = 1 / (1 + (smooth / 5e-3) ** 2)
    numbers = (4 * np.pi * 64 * window(dark * trials * x) for x in (fraction, smooth))
    ones, of_network = (
        (gamma(n + 1.5 / threshold) / gamma(n + 0.5 / threshold)) ** threshold for n in numbers
    )
    expected = smooth * (ones / of_network) ** dark
    given = (np.float32(each) for each in (p, fraction))
    number = trials if isinstance(trials, int) else np.float32(trials)
    found = match_dark_regions(*given, number, threshold)
    # The intensity is about p^(1/q). The windows of the twin differ a little.
    np.testing.assert_allclose(found ** (1 / threshold), expected ** (1 / threshold), rtol=0.05)


@pytest.mark.parametrize("threshold", [1, 2, 8])
@pytest.mark.parametrize("trials", [30, np.geomspace(4, 64, 48 * 70).reshape(48, 70)])
def test_probabilities_agree_with_numpy_up_to_rounding(trials, threshold):
    rng = np.random.default_rng(1)
    p = rng.choice(np.float32([-1e-3, 0, 1e-6, 1e-4, 1e-3, 1e-2, 0.2, 1]), (48, 70))
    fraction = np.float32(rng.poisson(0.3 * trials * np.maximum(p, 0)) / trials)
    number = trials if isinstance(trials, int) else np.float32(trials)
    found = match_dark_regions(p, fraction, number, threshold)
    expected = twin.matched(p, fraction, number, threshold)
    np.testing.assert_allclose(found, expected, rtol=2e-5 * threshold, atol=1e-37)
    np.testing.assert_array_equal(match_dark_regions(p, fraction, number, threshold, 1), found)


@pytest.mark.parametrize(
    ("frames", "gain", "threshold"), [(16, 48.0, 3), (30, 150.0, 8), (256, 9.0, 2), (64, 0.9, 1)]
)
def test_images_agree_with_numpy_up_to_rounding(frames, gain, threshold):
    sensor = jl.Sensor(frames=frames, gain=gain, threshold=threshold)
    # Squares of pixels would change images of 32 rows and more.
    bits = sensor.expose(photograph()[:31], rng=0)
    counts, network = bits.counts(), jl.pretrained(sensor, "small")
    expected = twin.corrected(network, counts, sensor)
    assert (expected != twin.plain_estimate(network, counts, sensor)).any()
    for data in (bits, counts, jl.Merged(counts, float(frames), sensor)):
        found = network.reconstruct(data, sensor)
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)
        np.testing.assert_array_equal(network.reconstruct(data, sensor, threads=1), found)


def test_bright_probabilities_stay_as_they_are():
    p = np.random.default_rng(0).uniform(5e-3, 1, (16, 16)).astype(np.float32)
    np.testing.assert_array_equal(match_dark_regions(p, p, 16, 3), p)


@pytest.mark.parametrize("wrong", [-0.01, np.nan, np.inf])
def test_fractions_that_are_negative_or_not_finite_are_refused(wrong):
    p, fraction = np.full((8, 8), 1e-4, np.float32), np.zeros((8, 8), np.float32)
    fraction[3, 5] = wrong
    with pytest.raises(ValueError, match="fractions: expected finite numbers of at least 0"):
        match_dark_regions(p, fraction, 16, 3)


def test_the_largest_threshold_causes_no_overflow():
    p = np.full((8, 8), 1e-4, np.float32)
    found = match_dark_regions(p, np.zeros((8, 8), np.float32), 16, 65_535)
    assert (found >= 0).all()
    assert (found < 1e-4).all()


@pytest.mark.parametrize(("threshold", "gain"), [(2, 9.0), (3, 15.0), (5, 30.0), (8, 150.0)])
def test_without_ones_an_image_is_dark(threshold, gain):
    sensor = jl.Sensor(frames=30, gain=gain, threshold=threshold)
    bits = jl.Bits.from_array(np.zeros((30, 64, 64), bool), sensor)
    found = jl.reconstruct(bits)
    # With more light than this everywhere, all bits would be 0 with a probability below 1 %.
    p = 1 - 0.01 ** (1 / np.asarray(bits).size)
    assert found.max() < gammaincinv(threshold, p) * 30 / gain
    assert jl.uncertainty(bits).low.max() == 0


@pytest.mark.parametrize(
    ("threshold", "photons", "frames"),
    [(3, 1.0, 30), pytest.param(5, 2.0, 30, marks=pytest.mark.slow)]
    + [pytest.param(*each, marks=pytest.mark.slow) for each in ((8, 5.0, 30), (5, 2.0, 256))],
)
@pytest.mark.parametrize("quality", ["small", pytest.param("medium", marks=pytest.mark.slow)])
def test_dark_regions_behind_high_thresholds_are_dark(threshold, photons, frames, quality):
    image = photograph()
    sensor = jl.Sensor(frames=frames, gain=frames * photons, threshold=threshold)
    bits = sensor.expose(image, rng=1)
    found = jl.reconstruct(bits, quality=quality)
    assert psnr(found, image) > psnr(jl.reconstruct(bits, method="admm-tv"), image) + 0.1
    limits = jl.uncertainty(bits, quality=quality, confidence_level=0.9)
    assert np.mean((limits.low <= image) & (image <= limits.high)) > 0.88


def test_pixels_that_are_not_dark_keep_their_intensity():
    sensor = jl.Sensor(frames=16, gain=48.0, threshold=3)
    image = np.tile(np.linspace(0.01, 1, 64), (64, 1))
    counts = sensor.expose(image, rng=0).counts()
    found = jl.reconstruct(counts, sensor)
    assert may_have_dark_regions(found, sensor)
    before = twin.plain_estimate(jl.pretrained(sensor), counts, sensor)
    bright = image > 0.98
    np.testing.assert_array_equal(found[bright], before[bright])
    assert not np.array_equal(found, before)
