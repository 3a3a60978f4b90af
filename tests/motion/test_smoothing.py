import numpy as np
import pytest

from jotlight.motion.smoothing import smoothing_weights


@pytest.mark.parametrize("place", [0.0, 3.3, 15.5, 31.0])
def test_parabolas_keep_their_values(place):
    places = np.arange(32.0)
    series = np.stack([3 + 0.5 * places - 0.1 * places**2, places], axis=1)
    weights = smoothing_weights(series, np.full(2, 1e-4), place)
    expected = [3 + 0.5 * place - 0.1 * place**2, place]
    np.testing.assert_allclose(weights @ series, expected, atol=1e-5)


def test_noise_is_averaged_over_many_blocks():
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 0.1, (32, 2))
    weights = smoothing_weights(noise, np.full(2, 0.01), 15.5)
    assert (weights**2).sum() < 0.12  # two blocks alone would have 0.5
    assert weights.sum() == pytest.approx(1)


def test_fast_changes_are_followed():
    places = np.arange(32.0)
    series = 5 * np.sin(2 * np.pi * places / 10)[:, None]
    weights = smoothing_weights(series, np.full(1, 1e-4), 12.0)
    assert weights @ series[:, 0] == pytest.approx(series[12, 0], abs=0.05)
