"""Random mosaics for training."""

import numpy as np
import pytest

from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.training.random_mosaics import KINDS, random_mosaic


@pytest.mark.slow
def test_the_kinds_have_their_fractions():
    assert sum(fraction for _, fraction in KINDS) == pytest.approx(1)
    rng = np.random.default_rng(0)
    found = [random_mosaic(rng, 32) for _ in range(1000)]
    scattered = [each for each in found if not each.repeats]
    bayer = [each for each in found if each.bayer and each.is_ideal]
    assert abs(len(bayer) / 1000 - KINDS[0][1]) < 0.08  # 5 standard deviations
    assert abs(len(scattered) / 1000 - 0.08) < 0.043
    assert {each.bayer for each in bayer} == {"RGGB", "BGGR", "GRBG", "GBRG"}


def test_all_have_ideal_or_mixed_filters_and_fit_the_image():
    rng = np.random.default_rng(1)
    for make, _ in KINDS:
        mosaic = make(rng, 24)
        assert isinstance(mosaic, Mosaic)
        assert mosaic.full(24, 24).shape == (24, 24)
        assert np.linalg.matrix_rank(mosaic.transmission) == 3
        assert ((mosaic.transmission >= 0) & (mosaic.transmission <= 1)).all()
