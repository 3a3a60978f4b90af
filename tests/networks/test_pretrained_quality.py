"""The quality of the trained networks on photographs."""

import functools

import numpy as np
import pytest

import jotlight as jl
from jotlight.images.io import read_image
from jotlight.networks.pretrained import TRAINED_TRIALS, pretrained

SPACE = [jl.Sensor(oversampling=round(bits**0.5)) for bits in TRAINED_TRIALS]

# Minimum gain in dB on the image "camera" over maximum likelihood, and over the initial network
# with σ = 0.7, by K. The second one vanishes for many bits, since this image is smoother than the
# images of the training set.
GAINS = {
    9: (10, 4.5), 16: (9, 3.2), 25: (8, 2.2), 36: (7, 1.4), 49: (6, 0.8), 64: (5, 0.4),
    81: (4, 0.1), 100: (3, -0.15),
}  # fmt: skip


@functools.cache
def camera():
    return jl.datasets.photograph("camera")


@functools.cache
def photographs(data):
    """The first twenty test images, which no network was trained on."""
    folder = data / "bsds300" / "test"
    if not folder.is_dir():
        pytest.skip(f"no BSDS300 in {data}")
    paths = sorted(folder.glob("*.jpg"))[:20]
    assert len(paths) == 20
    return [read_image(path, gray=True) for path in paths]


@pytest.mark.parametrize("sensor", SPACE, ids=repr)
def test_a_network_beats_maximum_likelihood_and_its_own_start(sensor):
    bits = sensor.expose(camera(), rng=0)
    quality = {
        name: jl.metrics.psnr(estimate, camera())
        for name, estimate in {
            "learned": pretrained(sensor, "two-layer").reconstruct(bits),
            "likelihood": jl.mle(bits, sensor),
            "start": jl.Network.initial(sensor).reconstruct(bits),
        }.items()
    }
    over_likelihood, over_start = GAINS[sensor.trials]
    assert quality["learned"] > quality["likelihood"] + over_likelihood
    assert quality["learned"] > quality["start"] + over_start


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SPACE, ids=repr)
def test_a_network_beats_smoothing_on_test_photographs(data, sensor):
    images = [image[80:240, 80:240] for image in photographs(data)]

    def quality(network):
        """PSNR of the mean square error, which training minimizes."""
        estimates = [
            network.reconstruct(sensor.expose(image, rng=number))
            for number, image in enumerate(images)
        ]
        return jl.metrics.psnr(np.stack(estimates), np.stack(images))

    for sigma in (0.7, 1.0):
        smoother = jl.Network.initial(sensor, sigma=sigma)
        assert quality(pretrained(sensor, "two-layer")) > quality(smoother) + 0.1


# From K = 49, smoothing with σ = 1 is better on this image.
@pytest.mark.parametrize(("side", "gain"), [(3, 2.2), (4, 1.1), (5, 0.4), (6, 0.0)])
def test_a_network_for_few_bits_beats_smoothing_on_other_photographs_too(side, gain):
    sensor = jl.Sensor(oversampling=side)
    bits = sensor.expose(camera(), rng=0)
    smooth = jl.Network.initial(sensor, sigma=1.0).reconstruct(bits)
    learned = jl.metrics.psnr(pretrained(sensor, "two-layer").reconstruct(bits), camera())
    assert learned > jl.metrics.psnr(smooth, camera()) + gain


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quality", "least"),
    [
        ("two-layer", 24.30),
        ("small", 25.95),
        ("medium", 26.43),
        ("large", 26.70),
        pytest.param("extra-large", 26.75, marks=pytest.mark.exhaustive),
    ],
)
def test_networks_reach_the_documented_psnr(data, quality, least):
    sensor = jl.Sensor(frames=16)
    images = photographs(data)
    assert jl.evaluate(pretrained(sensor, quality), images, sensor).mean("psnr") >= least


# Minimum gain in dB of the medium network over total variation.
EXPOSURES = {
    "one bit": (jl.Sensor(), 1.4),
    "four frames": (jl.Sensor(frames=4), 1.6),
    "sixteen jots": (jl.Sensor(oversampling=4), 1.4),
    "many frames": (jl.Sensor(frames=256), 1.8),
    "dim": (jl.Sensor(frames=16, gain=0.8), 1.4),
    "bright": (jl.Sensor(frames=64, gain=256), 1.3),
    "dark counts": (jl.Sensor(frames=16, dark_counts=0.2), 1.4),
    "a higher threshold": (jl.Sensor(frames=16, gain=48, threshold=2), 1.3),
}


@pytest.mark.slow
@pytest.mark.parametrize(("sensor", "gain"), EXPOSURES.values(), ids=EXPOSURES)
def test_the_medium_network_serves_any_exposure_better_than_total_variation(sensor, gain):
    image = camera()
    bits = sensor.expose(image, rng=1)
    ours = jl.metrics.psnr(pretrained(sensor).reconstruct(bits), image)
    assert ours > jl.metrics.psnr(jl.noniterative(bits, sensor, denoiser="tv"), image) + gain


@pytest.mark.parametrize("bits", TRAINED_TRIALS)
def test_the_small_network_beats_the_two_layer_one(bits):
    sensor, image = jl.Sensor(frames=bits), camera()[64:192, 160:288]
    seen = sensor.expose(image, rng=1)
    small, two_layer = (
        jl.metrics.psnr(pretrained(sensor, quality).reconstruct(seen), image)
        for quality in ("small", "two-layer")
    )
    assert small > two_layer + 0.5


@pytest.mark.slow
@pytest.mark.parametrize("bits", [1, 4, 16, 64, 256])
def test_the_large_network_beats_the_medium_one(bits):
    image = camera()
    for sensor in (jl.Sensor(frames=bits), jl.Sensor(frames=bits, gain=0.2 * bits)):
        seen = sensor.expose(image, rng=1)
        large, medium = (
            jl.metrics.psnr(pretrained(sensor, quality).reconstruct(seen), image)
            for quality in ("large", "medium")
        )
        assert large > medium
