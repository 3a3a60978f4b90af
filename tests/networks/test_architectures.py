"""Networks at their initial parameters."""

import numpy as np
import pytest
from scipy.ndimage import convolve

import jotlight as jl
from reference import deep, methods, networks
from reference.deep import random_counts
from reference.networks import random_bits


@pytest.mark.parametrize("sigma", [0.25, 0.7, 1.0, 3.0])
@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(oversampling=3),
        jl.Sensor(oversampling=4),
        jl.Sensor(frames=100),
        jl.Sensor(frames=25, threshold=2, max_intensity=4.0),
        jl.Sensor(frames=36, dark_counts=0.1, efficiency=0.6, gain=50.0, max_intensity=1.5),
    ],
    ids=repr,
)
def test_the_initial_network_equals_the_noniterative_method_with_a_gaussian(sensor, sigma):
    bits = sensor.trials
    line = np.exp(-0.5 * (np.arange(15) - 7) ** 2 / sigma**2)
    gaussian = np.outer(line, line) / line.sum() ** 2
    network = jl.Network.initial(sensor, sigma=sigma)
    np.testing.assert_allclose(network.layers[1].filters[0, 0], gaussian, rtol=1e-6, atol=1e-12)

    def intensity(z):
        return methods.mle(
            np.clip(methods.algebraic_inverse(z, bits), 0, bits),
            bits,
            threshold=sensor.threshold,
            sensitivity=sensor.efficiency * sensor.gain / bits,
            dark=sensor.dark_counts,
            max_intensity=sensor.max_intensity,
        )

    def curve(layer, z):
        return networks.spline(z, layer.coefficients[0], layer.start, layer.spacing)

    # Only the splines have errors. h2 is an average, which does not increase them.
    first, second = network.layers
    counts = np.arange(bits + 1)
    z = np.linspace(*methods.anscombe(np.array([0, bits]), bits), 20_001)
    first_error = np.abs(curve(first, counts) - methods.anscombe(counts, bits)).max()
    second_error = np.abs(curve(second, z) - intensity(z)).max()
    steepest = np.abs(np.diff(intensity(z)) / np.diff(z)).max()
    bound = steepest * first_error + second_error + 1e-5
    assert bound < 0.02 * sensor.max_intensity

    seen = np.random.default_rng(6).integers(0, bits + 1, (20, 30))
    expected = jl.noniterative(
        seen,
        sensor,
        denoiser=lambda image: convolve(image, gaussian, mode="reflect"),
        inverse="algebraic",
    )
    np.testing.assert_allclose(network.reconstruct(seen), expected, atol=bound)


def test_a_map_of_dark_counts_enters_by_the_median_of_valid_jots():
    dark = np.array([[0.1, 0.2, 0.3], [4.0, 9.0, 9.0]])
    mapped = jl.Sensor(frames=16, dark_counts=dark, mask=dark == 9)
    plain = jl.Sensor(frames=16, dark_counts=0.25)
    for mine, theirs in zip(
        jl.Network.initial(mapped).layers, jl.Network.initial(plain).layers, strict=True
    ):
        np.testing.assert_allclose(mine.coefficients, theirs.coefficients, atol=1e-5)


def test_tied_and_untied_initial_networks_are_equal():
    sensor = jl.Sensor(oversampling=3, frames=2)
    bits = jl.Bits.from_array(random_bits(np.random.default_rng(7), sensor, 8, 9))
    tied, untied = (jl.Network.initial(sensor, tied=tied) for tied in (True, False))
    assert (tied.tied, untied.tied) == (True, False)
    assert untied.layers[0].filters.shape == (1, 2, 3, 3)
    np.testing.assert_array_equal(untied.reconstruct(bits), tied.reconstruct(bits))


@pytest.mark.parametrize("most", [0.3, 1.0, 8.0])
def test_initial_estimates_lie_in_0_to_s(most):
    sensor = jl.Sensor(frames=9, max_intensity=most)
    counts = np.random.default_rng(8).choice([0, 4, 9], (40, 50))
    estimate = jl.Network.initial(sensor, sigma=0.4).reconstruct(counts)
    assert estimate.min() >= 0
    assert estimate.max() <= np.float32(most)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sigma": 0}, "sigma: expected a finite number above 0"),
        ({"sigma": "1"}, "sigma: expected a finite number above 0, got '1'"),
        ({"nu": "1"}, "nu: expected .*, got '1'"),
        ({"sigma": np.nan}, "sigma"),
        ({"taps": 4}, "taps: expected an odd number, got 4"),
        ({"taps": -1}, "taps"),
        ({"taps": "1"}, "taps: expected a whole number, got '1'"),
        ({"coefficients": 4}, "coefficients: expected at least 5"),
        ({"coefficients": None}, "coefficients: expected a whole number, got None"),
    ],
)
def test_parameters_of_the_initial_network_out_of_range_are_refused(options, message):
    with pytest.raises((TypeError, ValueError), match=message):
        jl.Network.initial(jl.Sensor(), **options)


@pytest.mark.parametrize("taps", [1, 3, 21])
@pytest.mark.parametrize("coefficients", [5, 40])
def test_the_initial_network_has_the_requested_size(taps, coefficients):
    network = jl.Network.initial(jl.Sensor(), taps=taps, coefficients=coefficients)
    assert network.layers[1].filters.shape == (1, 1, taps, taps)
    assert {layer.coefficients.shape for layer in network.layers} == {(1, coefficients)}
    assert network.halo == taps // 2


SENSOR = jl.Sensor(oversampling=4)
ARCHITECTURES = ("small", "medium")


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_a_deep_network_starts_at_a_classical_estimate(name):
    image = np.full((40, 40), 0.5)
    bits = SENSOR.expose(image, 0)
    estimate = jl.Network.residual(SENSOR, name, rng=0).reconstruct(bits)
    assert abs(estimate.mean() - 0.5) < 0.05
    assert estimate.std() < 0.1
    for frames in (1, 16, 256):
        sensor = jl.Sensor(frames=frames, max_intensity=4.0)
        estimate = jl.Network.conditional(name, rng=0).reconstruct(sensor.expose(image, 0), sensor)
        assert abs(estimate.mean() - 0.5) < 0.1


@pytest.mark.parametrize("most", [0.3, 1.0, 7.0])
def test_estimates_of_residual_networks_lie_in_0_to_s(most):
    sensor = jl.Sensor(oversampling=4, max_intensity=most)
    for seed in range(4):
        start = jl.Network.residual(sensor, "small", rng=seed)
        network = deep.with_noise(start, np.random.default_rng(seed), size=5.0)
        estimate = network.reconstruct(random_counts(sensor, 60, 70, seed))
        assert estimate.min() >= 0
        assert estimate.max() <= np.float32(most)
        assert estimate.std() > 0.01 * most


def test_an_unknown_architecture_is_refused():
    with pytest.raises(ValueError, match="architecture: expected one of small, medium, large"):
        jl.Network.residual(SENSOR, "huge")
    with pytest.raises(ValueError, match="expected one of two-layer, small, medium, large, got"):
        jl.Network.conditional("extra-large")


@pytest.mark.parametrize("start", [jl.Network.initial, jl.Network.residual])
def test_anything_but_a_sensor_is_refused(start):
    with pytest.raises(TypeError, match=r"sensor: expected a jotlight\.Sensor, .*got 8"):
        start(8)
