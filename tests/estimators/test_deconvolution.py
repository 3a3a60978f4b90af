"""Deconvolution of the mean light of pixels."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.deconvolution import deconvolve, inverse_taps

KERNELS = "linear", "quadratic", "cubic"
SENSORS = [
    jl.Sensor(oversampling=side, kernel=kernel) for kernel in KERNELS for side in (1, 2, 3, 4)
]
IMAGE = jl.datasets.photograph("camera")[100:164, 180:260]

by_sensor = pytest.mark.parametrize("sensor", SENSORS, ids=repr)


def pixel_means(image, sensor):
    """Return the mean intensity at the jots of each pixel of an image (H, W)."""
    side = sensor.oversampling
    light = jl.operators.spread(image.shape, side, sensor.kernel, gain=side**2)
    jots = light.forward(image.astype(np.float64))
    height, width = image.shape
    return jots.reshape(height, side, width, side).mean((1, 3)).astype(np.float32)


@by_sensor
def test_means_are_those_of_the_light_of_the_sensor(sensor):
    # With q = 1 and weak light, the probability of a one is the light.
    weak = 1e-5
    light = sensor.probability(weak * IMAGE) / (weak * sensor.light_per_intensity)
    side = sensor.oversampling
    expected = light.reshape(IMAGE.shape[0], side, IMAGE.shape[1], side).mean((1, 3))
    np.testing.assert_allclose(pixel_means(IMAGE, sensor), expected, atol=1e-4)


@by_sensor
def test_uniform_images_do_not_change(sensor):
    uniform = np.full((20, 30), 0.4, np.float32)
    np.testing.assert_allclose(deconvolve(uniform, sensor), 0.4, atol=1e-6)


@by_sensor
def test_the_taps_are_the_regularized_least_squares_solution(sensor):
    """The oracle solves (AᵀA + λ) x = (1 + λ) Aᵀ b for a point far from the ends of a line."""
    size, weight = 201, 0.1
    matrix = np.stack(
        [pixel_means(row[None], sensor)[0] for row in np.eye(size, dtype=np.float32)], axis=1
    ).astype(np.float64)
    point = np.zeros(size)
    point[size // 2] = 1
    normal = matrix.T @ matrix + weight * np.eye(size)
    expected = np.linalg.solve(normal, (1 + weight) * matrix.T @ point)
    taps = inverse_taps(sensor.kernel, sensor.oversampling)
    radius = len(taps) // 2
    found = expected[size // 2 - radius : size // 2 + radius + 1]
    np.testing.assert_allclose(taps, found, atol=2e-5)


@by_sensor
def test_the_deconvolved_image_is_sharper(sensor):
    blurred = pixel_means(IMAGE, sensor)
    sharp = deconvolve(blurred, sensor)
    if np.allclose(blurred, IMAGE):
        pytest.skip("this kernel does not blur pixels")
    assert jl.metrics.psnr(sharp, IMAGE) > jl.metrics.psnr(blurred, IMAGE) + 1
    assert abs(sharp.mean() - IMAGE.mean()) < 0.01


def test_the_box_kernel_needs_none():
    assert deconvolve(IMAGE, jl.Sensor(oversampling=2)) is IMAGE


@pytest.mark.slow
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("quality", ["small", "medium"])
def test_networks_beat_total_variation_with_a_smooth_kernel(kernel, quality):
    sensor = jl.Sensor(oversampling=2, frames=16, kernel=kernel)
    bits = sensor.expose(IMAGE, rng=0)
    estimate = jl.reconstruct(bits, quality=quality)
    assert estimate.min() >= 0
    assert estimate.max() <= 1
    classical = jl.reconstruct(bits, method="admm-tv")
    assert jl.metrics.psnr(estimate, IMAGE) > jl.metrics.psnr(classical, IMAGE)
    # Counts are sufficient.
    np.testing.assert_array_equal(jl.reconstruct(bits.counts(2), sensor, quality=quality), estimate)
    stack = jl.reconstruct([bits, bits], quality=quality)
    np.testing.assert_array_equal(stack[1], estimate)


def test_pytorch_refuses_a_smooth_kernel():
    torch = pytest.importorskip("torch")
    from jotlight.torch import Network

    sensor = jl.Sensor(frames=16, kernel="cubic")
    module = Network(jl.pretrained(sensor, "small"))
    with pytest.raises(ValueError, match="expected the box kernel, got cubic; the engine serves"):
        module(torch.zeros(1, 1, 8, 8), sensor)
