"""Published accuracies, measured or computed from first principles."""

import numpy as np
import pytest
from PIL import Image
from scipy.integrate import quad
from scipy.stats import binom

import jotlight as jl

# The PSNR in dB of maximum likelihood for c uniform in [0, 1], S = 1, q = 1, by trials per pixel.
UNIFORM_PSNR = {9: 13.147, 16: 15.103, 25: 16.756, 36: 18.133}
UNIFORM_PSNR |= {49: 19.307, 64: 20.364, 81: 21.291, 100: 22.132}


@pytest.mark.parametrize("bits", UNIFORM_PSNR)
def test_the_exact_error_of_maximum_likelihood_is_that_of_the_table(bits):
    counts = np.arange(bits + 1)
    estimates = jl.mle(counts[None], jl.Sensor(frames=bits))[0].astype(float)

    def error(light):
        return binom.pmf(counts, bits, -np.expm1(-light)) @ (estimates - light) ** 2

    mean, _ = quad(error, 0, 1, epsabs=1e-10)
    assert -10 * np.log10(mean) == pytest.approx(UNIFORM_PSNR[bits], abs=6e-4)


@pytest.mark.parametrize("bits", UNIFORM_PSNR)
def test_the_simulated_error_of_maximum_likelihood_is_that_of_the_table(bits):
    scene = jl.datasets.uniform_scene((1024, 1024), rng=bits)
    sensor = jl.Sensor(oversampling=round(bits**0.5))
    errors = (jl.mle(sensor.expose(scene, rng=bits), sensor) - scene).astype(float) ** 2
    sampling_error = errors.std() / np.sqrt(errors.size)
    assert errors.mean() == pytest.approx(10 ** (-UNIFORM_PSNR[bits] / 10), abs=4 * sampling_error)


@pytest.fixture(scope="module")
def photographs(data):
    files = sorted((data / "bsds300" / "test").glob("*.jpg"))[:20]
    assert len(files) == 20
    return [np.asarray(Image.open(file).convert("L"), np.float32) / 255 for file in files]


@pytest.fixture(scope="module")
def captures(photographs):
    sensor = jl.Sensor(oversampling=4)
    return [
        (sensor.expose(photograph, rng=index), photograph)
        for index, photograph in enumerate(photographs)
    ]


def mean_psnr(method, captures):
    return np.mean([jl.metrics.psnr(method(bits), truth) for bits, truth in captures])


def test_maximum_likelihood_reaches_its_psnr_on_photographs(captures):
    sensor = jl.Sensor(oversampling=4)
    assert mean_psnr(lambda bits: jl.mle(bits, sensor), captures) == pytest.approx(15.48, abs=0.05)


@pytest.mark.parametrize(("sigma", "decibel"), [(0.5, 18.95), (1.0, 23.66)])
def test_the_initial_network_reaches_its_psnr_on_photographs(captures, sigma, decibel):
    network = jl.Network.initial(jl.Sensor(oversampling=4), sigma=sigma)
    assert mean_psnr(network.reconstruct, captures) == pytest.approx(decibel, abs=0.1)


def test_the_exact_inverse_has_a_higher_psnr_than_the_algebraic_one_on_photographs(captures):
    sensor = jl.Sensor(oversampling=4)
    exact, algebraic = (
        mean_psnr(
            lambda bits, inverse=inverse: jl.noniterative(
                bits, sensor, denoiser="gaussian", inverse=inverse
            ),
            captures[:5],
        )
        for inverse in ("exact", "algebraic")
    )
    assert exact > algebraic + 0.05
