import numpy as np
import pytest
from scipy.special import gammainc

import jotlight as jl
from jotlight.estimators.inverse_response import equivalent_counts, intensity_from_probability
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.likelihood.reference import Jot
from reference import methods


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_intensity_from_a_probability_is_equation_5(threshold):
    sensor = jl.Sensor(
        frames=16, threshold=threshold, efficiency=0.8, dark_counts=0.1, max_intensity=3.0
    )
    probability = np.linspace(0, 1, 101, dtype=np.float32)
    expected = methods.mle(
        probability, 1, threshold=threshold, sensitivity=0.8, dark=0.1, max_intensity=3.0
    )
    estimate = intensity_from_probability(probability, sensor, None)
    np.testing.assert_allclose(estimate, expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("threshold", [1, 3])
def test_equivalent_counts_are_those_the_reference_jot_would_show(threshold):
    sensor = jl.Sensor(frames=16, threshold=threshold, max_intensity=20.0)
    counts = np.arange(16)[None]
    light = methods.mle(counts, 16, threshold=threshold, max_intensity=20.0)
    expected = 16 * gammainc(threshold, 0.5 * light + 0.2)
    pixels = count_pixels(counts, sensor, None)
    np.testing.assert_allclose(
        equivalent_counts(pixels, Jot(0.5, 0.2), 16, None), expected, atol=1e-4
    )


def test_pixels_that_say_nothing_have_the_counts_of_their_neighbors():
    # With 0 ones of 0.01 trials, they would be dark.
    merged = jl.Merged([[3, 0, 0, 1]], [[4.0, 0.01, 0.01, 2.0]], jl.Sensor(frames=4))
    pixels = count_pixels(merged, merged.sensor, None)
    np.testing.assert_allclose(equivalent_counts(pixels, Jot(1.0, 0.0), 4, None), [[3, 3, 2, 2]])
    silent = jl.Merged([[0, 0]], [[0.01, 0.005]], jl.Sensor(frames=4))
    pixels = count_pixels(silent, silent.sensor, None)
    np.testing.assert_array_equal(equivalent_counts(pixels, Jot(1.0, 0.0), 4, None), [[0, 0]])


def test_counts_of_reference_jots_are_unchanged():
    sensor = jl.Sensor(frames=16, efficiency=0.5, dark_counts=0.2)
    counts = np.arange(17)[None]
    pixels = count_pixels(counts, sensor, None)
    np.testing.assert_array_equal(equivalent_counts(pixels, Jot(0.5, 0.2), 16, None), counts)


@pytest.mark.parametrize(
    ("kernel", "oversampling"),
    [(kernel, number) for kernel in ("linear", "quadratic", "cubic") for number in (1, 2, 3)],
)
def test_the_warning_about_a_smooth_kernel_names_its_shift(kernel, oversampling):
    sensor = jl.Sensor(kernel=kernel, oversampling=oversampling)
    scene = np.zeros((9, 9))
    scene[4, 4] = 1.0
    rates = sensor.rate(scene)
    places = np.arange(9 * oversampling) + 0.5
    centers = [(rates.sum(axis) * places).sum() / rates.sum() for axis in (0, 1)]
    shift = np.array(centers) - 4.5 * oversampling  # in jots
    with pytest.warns(jl.JotlightWarning, match="assumes the box kernel") as caught:
        jl.mle(sensor.expose(scene, rng=0))
    is_named = "moves it half a jot down and right" in str(caught[0].message)
    np.testing.assert_allclose(shift, 0.5 if is_named else 0.0, atol=1e-5)
