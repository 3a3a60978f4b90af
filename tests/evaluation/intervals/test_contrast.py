"""The contrast of the bits of nearly empty captures behind high thresholds."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.intervals.contrast import Contrast
from jotlight.sensing.parameters.response import detection_probability

Z = np.array([1e-6, 0.01, 0.3, 1.2])


@pytest.mark.parametrize("threshold", [2, 8, 200])
def test_the_factor_is_the_ratio_of_logarithmic_slopes(threshold):
    rates = np.geomspace(0.6 * threshold, 1.1 * threshold, 7)
    step = 1e-5

    def slope(q, rate):
        change = np.log(detection_probability(q, rate * (1 + step)))
        return (change - np.log(detection_probability(q, rate * (1 - step)))) / (2 * step)

    p = detection_probability(threshold, rates)
    ratio = slope(threshold, rates) / slope(1, -np.log1p(-p))
    found = Contrast(threshold, 1.0).factor(np.arcsin(np.sqrt(p)))
    np.testing.assert_allclose(found, np.sqrt(ratio), rtol=1e-3)


def test_dark_counts_hide_the_contrast():
    z = np.arcsin(np.sqrt(detection_probability(8, np.array([3.01, 4.0, 6.0]))))
    without, hidden = Contrast(8, 1.0).factor(z) ** 2, Contrast(8, 1.0, 3.0).factor(z) ** 2
    assert hidden[0] == 1
    np.testing.assert_allclose(hidden[1:], without[1:] * [1 / 4, 3 / 6], rtol=0.01)


def test_darkness_has_the_power_of_the_threshold():
    assert Contrast(8, 1.0).factor(np.array([0.0])) == pytest.approx(np.sqrt(8), rel=0.01)
    assert Contrast(8, 0.5).factor(np.array([0.0])) == pytest.approx(8**0.25, rel=0.01)


@pytest.mark.parametrize("threshold", [2, 16, 65535])
def test_all_probabilities_have_a_finite_factor(threshold):
    factor = Contrast(threshold, 1.0).factor(np.array([0.0, *Z, np.pi / 2]))
    assert (np.isfinite(factor) & (factor > 0)).all()


def test_threshold_1_and_many_ones_change_nothing():
    trials, dark, bright = np.full((8, 8), 16.0), np.full((8, 8), 0.01), np.full((8, 8), 1.3)
    assert Contrast.of(1, dark, trials).factor(dark) == 1
    np.testing.assert_allclose(Contrast.of(4, bright, trials).factor(dark), 1, atol=0.01)


def test_a_lamp_changes_only_its_surroundings():
    trials, z = np.full((128, 128), 16.0), np.full((128, 128), 0.01)
    z[8:16, 8:16] = 1.3
    factor = Contrast.of(4, z, trials).factor(z)
    np.testing.assert_allclose(factor[:24, :24], 1, atol=0.02)
    np.testing.assert_allclose(factor[64:, 64:], Contrast(4, 1.0).factor(z[64:, 64:]), rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("threshold", "photons"), [(4, 0.5), (8, 3.0)])
def test_intervals_of_nearly_empty_captures_contain_bright_and_dark_pixels(threshold, photons):
    image = jl.datasets.photograph("astronaut", gray=True)[::2, ::2][32:160, 32:160]
    sensor = jl.Sensor(frames=16, gain=16 * photons, threshold=threshold)
    found = jl.uncertainty(sensor.expose(image, rng=0))
    inside = (found.low <= image) & (image <= found.high)
    for part in (image < np.quantile(image, 0.2), image > np.quantile(image, 0.9)):
        assert inside[part].mean() > 0.94
