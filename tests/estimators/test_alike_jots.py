"""Counts of alike jots in place of those of jots that differ: no bias, and the noise of alike jots.

Estimates of sensors with maps are compared with those of a sensor whose jots are all alike.
"""

import functools

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.alike_jots import DifferentJots, alike_fractions
from jotlight.metrics import psnr
from jotlight.sensing.likelihood.reference import Jot
from jotlight.sensing.parameters.response import detection_probability

SIZE = 96, 96
RNG = np.random.default_rng(0)
DARK = RNG.gamma(1, 0.02, SIZE)
HOT = RNG.random(SIZE) < 0.02
WIDE = RNG.uniform(0.1, 1, SIZE)


def photograph():
    return jl.datasets.photograph("camera")[60:252:2, 160:352:2].astype(float)


@functools.cache
def large_maps():
    """Return maps of efficiency and dark counts for the mean of many jots."""
    rng = np.random.default_rng(1)
    return rng.uniform(0.3, 1, (1, 256, 256)), rng.gamma(1, 0.1, (1, 256, 256))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("threshold", "light"), [(1, 0.05), (1, 0.6), (1, 2.0), (3, 0.6), (3, 2.0), (3, 6.0)]
)
@pytest.mark.parametrize("trials", [2, pytest.param(16, marks=pytest.mark.exhaustive), 300])
def test_fractions_have_the_mean_and_the_variance_of_the_reference_jot(threshold, light, trials):
    rng = np.random.default_rng(2)
    efficiency, dark = large_maps()
    own = detection_probability(threshold, efficiency * light + dark)
    reference = Jot(0.6, 0.08)
    p = detection_probability(threshold, reference.efficiency * light + reference.dark_counts)
    ones = rng.binomial(trials, own)
    number = np.full(ones.shape, float(trials))
    found = alike_fractions(DifferentJots(ones, number, efficiency, dark, threshold), reference)
    assert found.min() >= 0
    assert found.max() <= 1
    noise = np.sqrt(p * (1 - p) / trials)
    assert found.mean() == pytest.approx(p, abs=5 * noise / 256 + 0.02 * p)
    # Debts that the next pixels pay take some noise away.
    assert 0.7 < found.std() / noise < 1.3


@pytest.mark.parametrize("method", ["network-medium", "noniterative-gaussian"])
@pytest.mark.parametrize(
    ("options", "loss"),
    [
        ({"frames": 16, "gain": 16 * 0.05, "dark_counts": DARK}, 0.5),
        ({"frames": 64, "gain": 64 * 0.05, "dark_counts": DARK}, 0.5),
        ({"frames": 32, "dark_counts": np.where(HOT, 5.0, 0.01)}, 0.5),
        ({"frames": 16, "gain": 16 * 3.0, "efficiency": WIDE}, 1.5),
        ({"frames": 64, "gain": 128.0, "threshold": 2, "efficiency": WIDE}, 1.5),
    ],
    ids=["dim", "dim, 64 frames", "hot", "efficiency", "threshold 2"],
)
def test_maps_cost_little_quality(options, loss, method):
    image, sensor = photograph(), jl.Sensor(**options)
    typical = {
        name: float(np.median(value))
        for name, value in options.items()
        if isinstance(value, np.ndarray)
    }
    alike = sensor.replace(**typical)
    found, expected = (
        jl.reconstruct(each.expose(image, rng=1), method=method) for each in (sensor, alike)
    )
    assert found.mean() == pytest.approx(image.mean(), rel=0.08)
    assert psnr(found, image) > psnr(expected, image) - loss


@pytest.mark.parametrize("method", ["network-medium", "noniterative-gaussian"])
@pytest.mark.parametrize(
    "options",
    [
        {"gain": 64 * 3.0, "efficiency": np.where(np.indices((192, 192))[1] % 2, 1.0, 0.2)},
        {"gain": 64 * 0.2, "dark_counts": np.random.default_rng(2).gamma(0.3, 0.1, (192, 192))},
    ],
    ids=["efficiency", "dark counts"],
)
def test_jots_of_a_pixel_may_differ(options, method):
    image, sensor = photograph(), jl.Sensor(oversampling=2, frames=16, **options)
    bits = sensor.expose(image, rng=1)
    found = jl.reconstruct(bits, method=method)
    assert found.mean() == pytest.approx(image.mean(), rel=0.05)
    assert psnr(found, image) > psnr(jl.reconstruct(bits, method="mle"), image)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["network-medium", "noniterative-gaussian", "admm-tv"])
@pytest.mark.parametrize("name", ["efficiency", "dark_counts"])
def test_brackets_of_jots_that_differ_have_no_bias(name, method):
    values = {"efficiency": WIDE, "dark_counts": RNG.gamma(0.3, 0.3, SIZE)}[name]
    gain = np.repeat([8, 1, 1 / 8], 16)
    sensor = jl.Sensor(frames=48, gain=gain, max_intensity=5.0, **{name: values})
    image = photograph()
    found = jl.reconstruct(sensor.expose(image, rng=1), method=method)
    # Total variation makes images of alike jots 4 % too dark, too.
    assert found.mean() == pytest.approx(image.mean(), rel=0.08)


@pytest.mark.parametrize("method", ["network-small", "noniterative-tv"])
def test_a_jot_that_contradicts_its_dark_counts_leaves_its_row_alone(method):
    stated = np.full((64, 64), 0.01)
    stated[30, 5] = 5.0
    bits = jl.Sensor(frames=256, dark_counts=0.01).expose(np.full((64, 64), 0.5), rng=0)
    sensor = bits.sensor.replace(dark_counts=stated)
    found = jl.reconstruct(jl.Bits(bits.packed, bits.width, sensor), method=method)
    assert found[30, 12:].mean() == pytest.approx(0.5, rel=0.06)


@pytest.mark.filterwarnings("ignore:.*no valid bit")
def test_dead_pixels_pay_no_debts():
    rng = np.random.default_rng(0)
    mask = rng.random((128, 128)) < 0.3
    dark = rng.uniform(0, 0.05, mask.shape)
    sensor = jl.Sensor(frames=4, gain=4 * 0.05, dark_counts=dark, mask=mask)
    found = jl.reconstruct(sensor.expose(np.full(mask.shape, 0.5), rng=0), quality="small")
    assert found.mean() == pytest.approx(0.5, rel=0.06)


@pytest.mark.parametrize("method", ["network-small", "noniterative-gaussian"])
@pytest.mark.parametrize("side", [1, 2])
def test_each_image_of_a_stack_is_that_of_itself(method, side):
    efficiency = np.random.default_rng(0).uniform(0.2, 1, (32 * side, 40 * side))
    sensor = jl.Sensor(oversampling=side, frames=8, efficiency=efficiency)
    images = [np.full((32, 40), light) for light in (0.1, 0.7)]
    stack = [sensor.expose(image, rng=1) for image in images]
    for found, bits in zip(jl.reconstruct(stack, method=method), stack, strict=True):
        np.testing.assert_array_equal(found, jl.reconstruct(bits, method=method))


@pytest.mark.parametrize("frames", [10**3, 10**8])
def test_rare_photons_are_right_in_any_number_of_frames(frames):
    rng = np.random.default_rng(0)
    efficiency = rng.uniform(0.5, 1, (48, 48)).astype(np.float32)
    counts = rng.poisson(3 * efficiency)
    sensor = jl.Sensor(frames=frames, gain=3.0, efficiency=efficiency, max_intensity=4.0)
    found = jl.reconstruct(counts, sensor, method="noniterative-gaussian")
    assert found.mean() == pytest.approx(1, rel=0.03)
