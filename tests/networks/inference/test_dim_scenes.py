"""Dim scenes: several trials as one. Total variation and the true image are the oracles."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.metrics import psnr
from jotlight.networks.inference.dim_scenes import combine, may_be_dim, trials_per_combined


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
    assert combine(fraction, 256) is None
    assert not may_be_dim(np.full((8, 8), 0.5, np.float32), jl.Sensor(), 16)


def test_combined_trials_are_those_of_every_pixel():
    rng = np.random.default_rng(0)
    trials = rng.uniform(200, 400, (32, 32)).astype(np.float32)
    fraction = (rng.binomial(300, 0.004, (32, 32)) / 300).astype(np.float32)
    combined, number, factor = combine(fraction, trials)
    np.testing.assert_allclose(number * factor, trials, rtol=1e-6)
    np.testing.assert_allclose(combined, fraction * factor, rtol=1e-6)


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
