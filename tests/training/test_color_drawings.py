"""Synthetic patches in color."""

import numpy as np
import pytest

from jotlight.training import ColorDrawings
from jotlight.training.color_drawings import draw_finest_rings


@pytest.mark.slow
def test_drawings_lie_on_a_line_between_two_colors_and_most_are_gray():
    rng = np.random.default_rng(0)
    gray = 0
    for _ in range(200):
        patch = ColorDrawings().draw(rng, 16)
        assert patch.values.shape == (3, 16, 16)
        assert patch.values.dtype == np.float32
        assert 0 <= patch.values.min() <= patch.values.max() <= 1
        assert patch.mosaic is not None
        points = patch.values.reshape(3, -1).T
        spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
        assert spread[1] <= 1e-4 * max(spread[0], 1)
        gray += bool(np.ptp(patch.values, axis=0).max() == 0)
    assert 125 <= gray <= 175  # 4 standard deviations


def test_channels_have_no_mosaic():
    source = ColorDrawings(mosaics=None)
    assert source.draw(np.random.default_rng(0), 8).mosaic is None
    assert source.fingerprint() != ColorDrawings().fingerprint()


def test_the_finest_rings_change_their_sign_from_pixel_to_pixel():
    """The correlation of neighbors is cos 2πf, on average -0.86 for f within 0.15 of a half."""
    rng = np.random.default_rng(3)
    lowest = []
    for _ in range(300):
        rings = draw_finest_rings(rng, 24).astype(np.float64)
        assert rings.shape == (24, 24)
        assert 0 <= rings.min() <= rings.max() <= 1
        wave = rings[8:16, 8:16] - (rings.min() + rings.max()) / 2
        wave /= max(abs(wave).max(), 1e-6)
        squares = (wave**2).mean()
        rows, columns = (wave[1:] * wave[:-1]).mean(), (wave[:, 1:] * wave[:, :-1]).mean()
        lowest.append(min(rows, columns) / squares)
    assert np.mean(lowest) < -0.8
    assert np.mean(np.array(lowest) < 0) > 0.99
