"""Patches of photographs in color."""

import numpy as np
import pytest

from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.training import ColorPatches, PhotographPatches

PHOTOGRAPH = np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8)


@pytest.mark.slow
def test_a_patch_is_a_part_of_the_photograph_under_a_symmetry():
    source = ColorPatches([PHOTOGRAPH], linear=0.0, scaled=0.0)
    rng = np.random.default_rng(2)
    channels = np.moveaxis(PHOTOGRAPH, 2, 0) / np.float32(255)
    found = [source.draw(rng, 40) for _ in range(30)]
    plain = [
        any(
            np.allclose(np.rot90(each, turn, (1, 2))[:, ::side], channels[:, :, left : left + 40])
            for turn in range(4)
            for side in (1, -1)
            for left in range(11)
        )
        for each, *_ in found
    ]
    assert 15 <= sum(plain) < 30  # the others are tinted
    assert found[0].image_mean == pytest.approx(channels.mean(), rel=1e-6)


def test_each_patch_has_its_own_mosaic_or_three_channels():
    rng = np.random.default_rng(0)
    found = [ColorPatches([PHOTOGRAPH]).draw(rng, 24).mosaic for _ in range(40)]
    assert len({each.filters for each in found}) > 1
    assert ColorPatches([PHOTOGRAPH], mosaics=None).draw(rng, 24).mosaic is None
    own = Mosaic("RGBW")
    source = ColorPatches([PHOTOGRAPH], mosaics=lambda rng, side: own)
    assert source.draw(rng, 24).mosaic is own
    assert source.fingerprint() != ColorPatches([PHOTOGRAPH]).fingerprint()


def test_gray_photographs_are_left_out():
    source = ColorPatches([PHOTOGRAPH, PHOTOGRAPH[..., 0]])
    assert len(source) == 1
    with pytest.raises(ValueError, match="photographs: expected at least one"):
        ColorPatches([PHOTOGRAPH[..., 0]])


def test_a_source_in_place_of_photographs_is_refused():
    with pytest.raises(
        TypeError, match=r"expected a list of uint8 arrays, .*got PhotographPatches"
    ):
        ColorPatches(PhotographPatches([PHOTOGRAPH]))
