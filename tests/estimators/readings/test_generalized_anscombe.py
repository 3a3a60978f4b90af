"""The generalized Anscombe transform, its exact inverse, and the non-iterative method with it."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.readings.generalized_anscombe import generalized_anscombe, transformed_mean
from jotlight.sensing.likelihood.multibit import ReadingLikelihood, reading_probability
from jotlight.sensing.parameters.response import JotResponse

NONE = np.zeros((1, 0), np.int32)


@pytest.mark.parametrize(("bit_depth", "noise"), [(8, 0.0), (8, 0.3), (8, 2.0)])
def test_the_noise_is_one_half(bit_depth, noise):
    # Well above 0 and below the largest reading, as for the transform of Poisson counts.
    for rate in (10.0, 30.0):
        readings = np.arange(2**bit_depth)
        weights = reading_probability(readings, rate, bit_depth=bit_depth, read_noise=noise)
        values = generalized_anscombe(readings, 1, noise).astype(float)
        deviation = np.sqrt(weights @ values**2 - (weights @ values) ** 2)
        assert deviation == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize(("bit_depth", "noise", "trials"), [(2, 0.3, 3), (4, 0.0, 2), (3, 0.5, 1)])
def test_the_mean_is_that_of_all_outcomes(bit_depth, noise, trials):
    jot = ReadingLikelihood(JotResponse(2**bit_depth - 1, noise, 1), NONE, False)
    rates = np.array([0.0, 0.3, 2.0, 9.0])
    readings = np.arange(2**bit_depth)
    for rate, mean in zip(rates, transformed_mean(jot, trials, rates), strict=True):
        weights = reading_probability(readings, rate, bit_depth=bit_depth, read_noise=noise)
        expected = 0.0
        for outcome in np.ndindex(*(2**bit_depth,) * trials):
            probability = np.prod(weights[list(outcome)])
            expected += probability * generalized_anscombe(sum(outcome), trials, noise)
        assert mean == pytest.approx(expected, rel=1e-6)


def test_long_totals_are_taken_as_normal():
    jot = ReadingLikelihood(JotResponse(255, 0.3, 1), NONE, False)
    rates = np.array([0.5, 20.0])
    exact, normal = (transformed_mean(jot, trials, rates) for trials in (16, 17))
    # One more reading changes little beyond the factor √(17/16).
    np.testing.assert_allclose(normal / np.sqrt(17 / 16), exact, rtol=1e-2)


@pytest.mark.parametrize(
    "sensor",
    [
        pytest.param(
            jl.Sensor(frames=4, gain=12.0, bit_depth=2, read_noise=0.3, max_intensity=2.0),
            marks=pytest.mark.slow,
        ),
        jl.Sensor(frames=4, gain=12.0, bit_depth=4, max_intensity=2.0),
        jl.Sensor(frames=16, read_noise=0.3, max_intensity=2.0),
    ],
)
def test_the_exact_inverse_has_no_bias(sensor):
    # The mean of the transform over many pixels of the same intensity is inverted.
    for intensity in (0.1, 0.7, 1.4):
        data = sensor.expose(np.full((200, 200), intensity), rng=0)

        def mean(z):
            return np.full(z.shape, z.mean())

        exact = jl.noniterative(data, denoiser=lambda z: mean(z))
        assert exact.mean() == pytest.approx(intensity, rel=0.02)
    algebraic = jl.noniterative(data, denoiser=lambda z: mean(z), inverse="algebraic")
    assert abs(algebraic.mean() - intensity) > abs(exact.mean() - intensity)


@pytest.mark.parametrize(
    ("frames", "photons"),
    [
        (1, 6.0),
        pytest.param(1, 12.0, marks=pytest.mark.slow),
        pytest.param(8, 12.0, marks=pytest.mark.slow),
    ],
)
def test_mostly_saturated_readings_keep_the_mean(frames, photons):
    truth = jl.datasets.photograph("coffee", gray=True)[40:240:2, 100:300:2].astype(np.float64)
    sensor = jl.Sensor(frames=frames, gain=frames * photons, bit_depth=2)
    readings = sensor.expose(truth, rng=0)
    found = jl.noniterative(readings)
    assert found.mean() == pytest.approx(truth.mean(), rel=0.07)
    stack = jl.noniterative([readings, sensor.expose(0.1 * truth, rng=0)])
    np.testing.assert_array_equal(stack[0], found)
    assert stack[1].mean() == pytest.approx(0.1 * truth.mean(), rel=0.07)


@pytest.mark.filterwarnings("ignore:.*no valid bit")
def test_readings_of_pixels_that_differ_become_counts():
    dark = np.linspace(0, 0.5, 64 * 64).reshape(64, 64)
    mask = np.random.default_rng(0).random(dark.shape) < 0.05
    sensor = jl.Sensor(frames=16, bit_depth=3, dark_counts=dark, mask=mask)
    found = jl.noniterative(sensor.expose(np.full(dark.shape, 0.5), rng=0))
    assert found.mean() == pytest.approx(0.5, rel=0.03)


def test_brackets_are_refused_with_advice():
    bracket = jl.Sensor(frames=2, gain=[1.0, 4.0], bit_depth=3)
    with pytest.raises(ValueError, match=r"expected one gain and one threshold.*reconstruct"):
        jl.noniterative(bracket.expose(np.full((8, 8), 0.5), rng=0))
