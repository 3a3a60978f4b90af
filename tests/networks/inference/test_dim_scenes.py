"""Dim scenes: several trials as one. Total variation and the true image are the oracles."""

import numpy as np
import pytest

import jotlight as jl
from jotlight._engine import Combined
from jotlight.metrics import psnr
from jotlight.networks.inference.dim_scenes import may_be_dim, trials_per_combined
from reference import dim_scenes as twin


def photograph():
    return jl.datasets.photograph("camera")[60:252:2, 160:352:2].astype(float)


@pytest.mark.parametrize(
    ("frames", "photons"),
    [(256, 0.002), (256, 0.01), (1000, 0.002), pytest.param(4000, 1e-4, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("quality", ["small", "medium"])
def test_dim_scenes_have_no_bias_and_are_better_than_total_variation(frames, photons, quality):
    image, sensor = photograph(), jl.Sensor(frames=frames, gain=frames * photons)
    bits = sensor.expose(image, rng=1)
    found = jl.reconstruct(bits, quality=quality)
    assert found.mean() == pytest.approx(image.mean(), rel=0.06)
    assert psnr(found, image) > psnr(jl.reconstruct(bits, method="admm-tv"), image) + 0.3


@pytest.mark.parametrize(
    "max_intensity", [10.0, *(pytest.param(each, marks=pytest.mark.slow) for each in (1.0, 1000.0))]
)
def test_the_largest_intensity_does_not_change_a_dim_image(max_intensity):
    image = 0.1 * photograph()
    sensor = jl.Sensor(frames=4, bit_depth=8, max_intensity=max_intensity)
    found = jl.reconstruct(sensor.expose(image, rng=0))
    assert found.mean() == pytest.approx(image.mean(), rel=0.05)


def test_a_few_bright_pixels_keep_their_intensity():
    image = np.full((64, 64), 0.002)
    image[20:24, 30:34] = 0.9
    sensor = jl.Sensor(frames=400)
    found = jl.reconstruct(sensor.expose(image, rng=0))
    assert found[21:23, 31:33].mean() == pytest.approx(0.9, rel=0.2)
    dark = np.ones(image.shape, bool)
    dark[8:36, 18:46] = False
    assert found[dark].mean() == pytest.approx(0.002, rel=0.2)


@pytest.mark.parametrize("quality", ["two-layer", "small"])
def test_the_sky_around_a_star_is_as_dark_as_elsewhere(quality):
    distance = np.hypot(*(np.indices((96, 96)) - 48))
    rates = 0.001 + 0.4 * np.exp(-(distance**2) / 3.4)
    sensor = jl.Sensor(frames=50_000, dark_counts=0.001, max_intensity=10)
    counts = np.random.default_rng(0).binomial(50_000, -np.expm1(-rates - 0.001))
    found = jl.reconstruct(counts, sensor, quality=quality)
    assert found[distance < 1].mean() == pytest.approx(rates[distance < 1].mean(), rel=0.1)
    sky = found[distance > 20].mean()
    assert sky == pytest.approx(0.001, rel=0.15)
    assert found[(distance > 6) & (distance < 12)].mean() == pytest.approx(sky, rel=0.05)


def test_lamps_keep_their_intensity_where_a_network_blurs_their_combined_trials():
    image = np.full((96, 96), 0.2)
    image[40:43, 40:43] = 20.0
    sensor = jl.Sensor(frames=256, gain=2.56, max_intensity=100.0)
    found = jl.reconstruct(sensor.expose(image, rng=0), quality="two-layer")
    assert found[40:43, 40:43].mean() > 0.4 * 20


def test_each_image_of_a_stack_is_that_of_itself():
    sensor = jl.Sensor(frames=256)
    images = np.stack([photograph() * scale for scale in (0.004, 1.0, 0.02)])
    stack = np.stack([sensor.expose(each, rng=1).counts() for each in images])
    found = jl.reconstruct(stack, sensor)
    for one, counts in zip(found, stack, strict=True):
        np.testing.assert_array_equal(one, jl.reconstruct(counts, sensor))


def test_bright_scenes_keep_their_trials():
    rng = np.random.default_rng(0)
    fraction = (rng.binomial(256, 0.2, (32, 32)) / 256).astype(np.float32)
    assert trials_per_combined(fraction, 256) == 1
    assert Combined.of(fraction, 256, 1) is None
    assert not may_be_dim(np.full((8, 8), 0.5, np.float32), jl.Sensor(frames=16))


def test_combined_trials_are_those_of_every_pixel():
    rng = np.random.default_rng(0)
    trials = rng.uniform(200, 400, (32, 32)).astype(np.float32)
    fraction = (rng.binomial(300, 0.004, (32, 32)) / 300).astype(np.float32)
    combined = Combined.of(fraction, trials, 1)
    np.testing.assert_allclose(combined.trials * combined.factor, trials, rtol=1e-6)
    np.testing.assert_allclose(combined.fractions, fraction * combined.factor, rtol=1e-6)


@pytest.mark.parametrize("smallest", [1, 9])
@pytest.mark.parametrize("rate", [0, 1e-3, 0.02, 0.1, 0.3])
@pytest.mark.parametrize("trials", [5, 100, 4000, "map"])
def test_combined_trials_agree_with_numpy(trials, rate, smallest):
    rng = np.random.default_rng(3)
    if trials == "map":
        trials = rng.uniform(200, 400, (31, 33)).astype(np.float32)
    p = np.minimum(rate * rng.gamma(2, 0.5, (31, 33)), 1)
    fraction = np.float32(rng.binomial(np.int64(trials), p) / trials)
    found, expected = (each(fraction, trials, smallest) for each in (Combined.of, twin.combined))
    factor = trials_per_combined(fraction, trials, smallest)
    assert factor == pytest.approx(twin.factor_of(fraction, trials, smallest), rel=1e-5)
    assert (found is None) == (expected is None)
    if found is None or expected is None:
        return
    fractions, number, factor = expected
    assert found.factor == pytest.approx(factor, rel=1e-5)
    np.testing.assert_allclose(found.fractions, fractions, rtol=1e-5)
    np.testing.assert_allclose(found.trials, number, rtol=1e-5)
    estimate = rng.random((31, 33), np.float32)
    weights = twin.weights(estimate, found.fractions)
    np.testing.assert_allclose(found.weights(estimate), weights, atol=1e-6)


def test_combined_trials_weigh_less_in_bright_pixels():
    fraction = np.zeros((64, 64), np.float32)
    fraction[0, :2] = 0.125, 0.25
    combined = Combined.of(fraction, 16, 1)
    np.testing.assert_array_equal(combined.fractions[0, :3], [0.5, 1.0, 0.0])
    for p, weights in ((0.01, [1, 0, 1]), (0.375, [0.5, 0, 0.5]), (0.9, [0, 0, 0])):
        found = combined.weights(np.full((64, 64), p, np.float32))
        np.testing.assert_allclose(found[0, :3], weights, atol=1e-6)


@pytest.mark.parametrize("threshold", [1, 3])
@pytest.mark.parametrize(
    ("frames", "photons"),
    [(16, 0.02), (100, 0.005), (100, 0.2), (1000, 0.001), (1000, 0.1), (16, 4.0)],
)
def test_images_agree_with_numpy_up_to_rounding(frames, photons, threshold):
    sensor = jl.Sensor(frames=frames, gain=frames * photons, threshold=threshold)
    # Squares of pixels would change images of 32 rows and more.
    bits = sensor.expose(photograph()[:31], rng=0)
    counts, network = bits.counts(), jl.pretrained(sensor, "small")
    expected = twin.corrected(network, counts, sensor)
    for data in (bits, counts, jl.Merged(counts, float(frames), sensor)):
        found = network.reconstruct(data, sensor)
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)
        np.testing.assert_array_equal(network.reconstruct(data, sensor, threads=1), found)


def test_bits_of_a_scene_without_light_are_black():
    for frames in (64, 1000):
        found = jl.reconstruct(np.zeros((16, 16), int), jl.Sensor(frames=frames))
        assert found.max() < 0.01


@pytest.mark.filterwarnings("ignore:.*no valid bit")
@pytest.mark.parametrize("dark_counts", [0.0, "map"])
def test_dead_pixels_are_no_darkness(dark_counts):
    rng = np.random.default_rng(0)
    mask = rng.random((64, 64)) < 0.1
    mask[20:24, 30:34] = True
    dark = rng.uniform(0, 0.01, mask.shape) if dark_counts == "map" else dark_counts
    sensor = jl.Sensor(frames=256, gain=2.56, mask=mask, dark_counts=dark)
    found = jl.reconstruct(sensor.expose(np.full(mask.shape, 0.5), rng=0))
    assert found[~mask].mean() == pytest.approx(0.5, rel=0.08)
    assert found[20:24, 30:34].mean() == pytest.approx(0.5, rel=0.2)
