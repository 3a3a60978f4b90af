"""Few photons: squares of pixels. Loops, closed forms, and the true image are the oracles."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.metrics import psnr
from jotlight.networks.inference.coarse_scales import (
    add_coarse,
    counts_of_squares,
    has_few_photons,
    sensor_of_squares,
    sum_counts,
)
from jotlight.networks.inference.engine_backed import sensor_model
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.likelihood.reference import response_of
from jotlight.squares import sum_squares
from reference import coarse_scales as twin

FEW = [(1, 0.2), (4, 0.02), (64, 0.002), (1000, 1e-4)]
"""Numbers of frames, and photons per frame at intensity 1."""


def photograph():
    return jl.datasets.photograph("camera")[60:252, 160:352].astype(float)


def without_squares(bits, quality="medium"):
    """Return the estimate of bits whose squares are not known to the engine."""
    sensor, counts = bits.sensor, bits.counts()
    engine, out = jl.pretrained(sensor, quality).engine_network, np.empty((1, *counts.shape), "f4")
    numbers = [sensor.trials], [sensor.trials]
    engine.equivalent_counts(
        np.float32(counts)[None], *numbers, sensor_model(sensor), list(out), None
    )
    return out[0]


@pytest.mark.parametrize(("frames", "photons"), FEW)
@pytest.mark.parametrize(
    "quality", ["medium", *(pytest.param(q, marks=pytest.mark.slow) for q in ("small", "large"))]
)
def test_images_of_few_photons_are_better_and_as_bright_as_the_scene(frames, photons, quality):
    image, sensor = photograph(), jl.Sensor(frames=frames, gain=frames * photons)
    bits = sensor.expose(image, rng=1)
    before = without_squares(bits, quality)
    found = jl.reconstruct(bits, quality=quality)
    assert psnr(found, image) > psnr(before, image) + 0.15
    # The number of ones determines the mean to this precision.
    ones = bits.counts().sum()
    assert found.mean() == pytest.approx(image.mean(), rel=0.03 + 3 / np.sqrt(ones))


def test_many_photons_need_no_squares():
    sensor = jl.Sensor(frames=16)
    bits = sensor.expose(photograph(), rng=0)
    found = jl.reconstruct(bits)
    np.testing.assert_array_equal(found, without_squares(bits))


@pytest.mark.parametrize("threshold", [1, 2])
def test_the_information_is_that_of_the_likelihood(threshold):
    """That of the twin is the mean squared derivative by the logarithm, by finite differences."""
    sensor = jl.Sensor(frames=8, gain=12.0, threshold=threshold, dark_counts=0.3, efficiency=0.6)
    step = 1e-5
    for intensity in (0.01, 0.4, 1.0):
        p, above, below = (
            response_of(sensor)(np.array(intensity * np.exp(shift))) for shift in (0, step, -step)
        )
        slope = (above - below) / (2 * step)
        expected = 8 * slope**2 / (p * (1 - p))
        assert twin.log_information(intensity, sensor, 8) == pytest.approx(expected, rel=1e-6)


def test_few_photons_are_counted_without_dark_counts():
    image = np.full((32, 40), 0.5, np.float32)
    sensor = jl.Sensor(frames=8, gain=4.0, dark_counts=5.0)
    assert has_few_photons(image, sensor, 8)
    assert not has_few_photons(image, sensor.replace(gain=8 * 1.6), 8)
    assert not has_few_photons(image[:31], sensor, 8)


@pytest.mark.parametrize("shape", [(4, 6), (5, 7)])
@pytest.mark.parametrize("threshold", [1, 3])
def test_counts_of_squares_are_those_of_a_loop(shape, threshold):
    rng = np.random.default_rng(0)
    trials = rng.uniform(1, 9, (2, *shape))
    trials[1, :2, :2] = 0
    counts = np.floor(rng.random(trials.shape) * trials).astype(np.int32)
    efficiency, dark = rng.uniform(0.2, 1, trials.shape), rng.uniform(0, 2, trials.shape)
    sensor = jl.Sensor(frames=9, threshold=threshold)
    pixels = PixelCounts(sensor, counts, trials, efficiency, dark, False)
    found = counts_of_squares(pixels, [0, 1], None)
    assert list(found) == [0, 1]
    assert found[0].sensor == sensor_of_squares(sensor)
    assert found[0].sensor.light_per_intensity == sensor.light_per_intensity
    rows, columns = (np.minimum(np.arange(n + n % 2), n - 1).reshape(-1, 2) for n in shape)
    for image, merged in found.items():
        for y, x in np.ndindex(merged.shape):
            square = np.ix_([image], rows[y], columns[x])
            number = trials[square].sum()
            weights = trials[square] / number if number else np.full((1, 2, 2), 0.25)
            assert merged.ones[y, x] == counts[square].sum()
            assert np.broadcast_to(merged.trials, merged.shape)[y, x] == pytest.approx(number)
            assert merged.efficiency[y, x] == pytest.approx((weights * efficiency[square]).sum())
            mean = (weights * dark[square]).sum()
            if threshold == 1:
                mean = -np.log((weights * np.exp(-dark[square])).sum())
            assert merged.dark_counts[y, x] == pytest.approx(mean)


def test_squares_of_many_dark_counts_have_finite_ones():
    dark = np.full((2, 2), 1000.0)
    found = sum_counts(np.ones((2, 2), np.int32), 1.0, 1.0, dark, jl.Sensor(frames=4))
    assert 700 < found.dark_counts[0, 0] < 1000


def test_pixels_alike_have_squares_alike():
    counts = np.ones((1, 4, 4), np.int32)
    pixels = PixelCounts(jl.Sensor(frames=3), counts, 3.0, 0.5, 0.1, False)
    merged = counts_of_squares(pixels, [0], None)[0]
    assert (merged.trials, merged.efficiency, merged.dark_counts) == (12.0, 0.5, 0.1)


def test_images_whose_squares_may_exceed_an_int32_are_left_out():
    counts = np.ones((2, 4, 4), np.int32)
    counts[1] = 2**29
    pixels = PixelCounts(jl.Sensor(frames=3), counts, 1e10, 0.5, 0.1, False)
    assert list(counts_of_squares(pixels, [0, 1], None)) == [0]
    counts[1] -= 1
    assert counts_of_squares(pixels, [1], None)[1].ones.max() == 2**31 - 4


@pytest.mark.parametrize("alike", [True, False])
def test_so_many_trials_that_squares_cannot_be_counted_have_an_image(alike):
    sensor = jl.Sensor(frames=2**29, gain=0.5)
    counts = np.random.default_rng(0).poisson(0.25, (32, 32)).astype(np.int32)
    dark_counts = 0.0 if alike else np.linspace(0, 1e-11, 1024).reshape(32, 32)
    merged = jl.Merged(counts, float(sensor.trials), sensor, dark_counts=dark_counts)
    found = jl.reconstruct(merged, quality="small")
    assert ((found >= 0) & (found <= 1)).all()


@pytest.mark.parametrize("threshold", [1, 3])
@pytest.mark.parametrize("shape", [(16, 16), (33, 41), (50, 64)])
def test_the_coarse_structure_agrees_with_scipy(shape, threshold):
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(
        frames=4, gain=3.0, threshold=threshold, dark_counts=0.05, efficiency=0.7, max_intensity=2.0
    )
    fine = np.float32(rng.gamma(0.5, 0.5, shape).clip(0, 2))
    coarse = np.float32(rng.gamma(0.5, 0.5, sum_squares(fine).shape).clip(0, 2))
    for trials in (4.0, rng.uniform(1, 40, coarse.shape)):
        found = add_coarse(fine, coarse, sensor, trials)
        expected = twin.add_coarse(fine, coarse, sensor, trials)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)
        np.testing.assert_array_equal(add_coarse(fine, coarse, sensor, trials, 1), found)


@pytest.mark.parametrize("threshold", [1, 3])
@pytest.mark.parametrize(("frames", "photons"), [*FEW, (16, 0.05), (1000, 0.3)])
def test_images_agree_with_the_twin_up_to_rounding(frames, photons, threshold):
    sensor = jl.Sensor(frames=frames, gain=frames * photons, threshold=threshold)
    bits = sensor.expose(photograph()[:65, :97], rng=0)
    counts, network = bits.counts(), jl.pretrained(sensor, "small")
    expected = twin.corrected(network, counts, sensor)
    for data in (bits, counts, jl.Merged(counts, float(frames), sensor)):
        found = network.reconstruct(data, sensor)
        np.testing.assert_allclose(found, expected, rtol=2e-4, atol=1e-6)
        np.testing.assert_array_equal(network.reconstruct(data, sensor, threads=1), found)


@pytest.mark.parametrize("shape", [(32, 40), (33, 41)])
def test_a_constant_image_moves_toward_that_of_the_squares(shape):
    squares = sensor_of_squares(jl.Sensor(frames=1))
    fine = np.full(shape, 0.3, np.float32)
    coarse = np.full(sum_squares(fine).shape, 0.5, np.float32)
    information = 0.25 * np.exp(-0.5) / -np.expm1(-0.5)
    p, other = -np.expm1(-0.3), -np.expm1(-0.5)
    expected = -np.log1p(-(p + (other - p) / (1 + 2 * information)))
    np.testing.assert_allclose(add_coarse(fine, coarse, squares, 4), expected, rtol=1e-5)
    # If a pixel has many photons, squares say nothing new.
    np.testing.assert_allclose(add_coarse(fine, coarse, squares, 4e9), 0.3, rtol=1e-5)


def test_images_stay_within_the_range():
    squares = sensor_of_squares(jl.Sensor(frames=1, max_intensity=0.6, dark_counts=0.2))
    fine = np.tile(np.float32([0.0, 0.6]), (32, 16))
    coarse = np.tile(np.float32([0.6, 0.0]), (16, 8))
    found = add_coarse(fine, coarse, squares, 4)
    assert found.dtype == np.float32
    assert found.min() >= 0
    assert found.max() <= np.float32(0.6)


def test_each_image_of_a_stack_is_that_of_itself():
    sensor = jl.Sensor(frames=4)
    images = np.stack([photograph()[:65, :64] * scale for scale in (0.02, 1.0, 0.2)])
    stack = np.stack([sensor.expose(each, rng=1).counts() for each in images])
    found = jl.reconstruct(stack, sensor)
    for one, counts in zip(found, stack, strict=True):
        np.testing.assert_array_equal(one, jl.reconstruct(counts, sensor))
        np.testing.assert_array_equal(one, jl.reconstruct(counts, sensor, threads=1))


@pytest.mark.filterwarnings("ignore:.*no valid bit")
@pytest.mark.parametrize("oversampling", [1, 2])
def test_dead_and_different_jots_leave_no_pattern(oversampling):
    rng = np.random.default_rng(0)
    shape = (96 * oversampling,) * 2
    sensor = jl.Sensor(
        frames=4,
        gain=2.0 * oversampling**2,
        oversampling=oversampling,
        efficiency=np.where(np.arange(shape[1]) < shape[1] // 2, 0.5, 1.0) * np.ones(shape),
        dark_counts=rng.gamma(1, 0.002, shape),
        mask=rng.random(shape) < 0.1,
    )
    found = jl.reconstruct(sensor.expose(np.full((96, 96), 0.5), rng=0))
    for half in (found[:, :40], found[:, 56:]):
        assert half.mean() == pytest.approx(0.5, rel=0.1)
    assert found.std() < 0.08


def test_squares_warn_no_more_than_their_pixels(recwarn):
    mask = np.zeros((64, 64), bool)
    mask[20:30, 20:30] = True
    sensor = jl.Sensor(frames=1, gain=0.5, mask=mask)
    jl.reconstruct(sensor.expose(np.full(mask.shape, 0.5), rng=0))
    assert len([each for each in recwarn if "no valid bit" in str(each.message)]) == 1
