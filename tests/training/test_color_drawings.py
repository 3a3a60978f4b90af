"""Synthetic patches in color."""

import numpy as np
import pytest

from jotlight.training import ColorDrawings


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
