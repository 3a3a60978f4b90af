"""Parts of an image that contain the pixels of a map."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jotlight.networks.regions import Band, cover


@given(
    seed=st.integers(0, 10**6),
    density=st.sampled_from([0, 0.0003, 0.003, 0.1, 1]),
    height=st.integers(1, 300),
    width=st.integers(1, 200),
    halo=st.sampled_from([0, 3, 40]),
)
def test_bands_contain_all_needed_pixels_once_with_their_halos(seed, density, height, width, halo):
    needed = np.random.default_rng(seed).random((height, width)) < density
    columns = np.broadcast_to(np.arange(width), needed.shape)
    times = np.zeros(needed.shape, int)
    for band in cover(needed, halo):
        parts = band.cut(columns)
        assert parts.shape[1] <= width
        assert len(parts) == min(band.rows.stop + halo, height) - max(band.rows.start - halo, 0)
        for place, values in band.pieces(parts):
            times[place] += 1
            np.testing.assert_array_equal(values, columns[place])
            near = needed[place].any(axis=0).nonzero()[0] + place[1].start
            if len(near):
                assert place[1].start <= max(near[0] - halo, 0)
                assert place[1].stop >= min(near[-1] + halo + 1, width)
    assert times.max(initial=0) <= 1
    assert (times[needed] == 1).all()
    assert needed.any() or not times.any()


def test_the_sides_of_a_border_are_denoised_side_by_side():
    needed = np.zeros((320, 320), bool)
    needed[:5] = needed[-5:] = needed[:, :5] = needed[:, -5:] = True
    sides = slice(0, 16), slice(304, 320)
    whole = (slice(0, 320),)
    assert cover(needed, 8) == [
        Band(slice(0, 16), slice(0, 24), whole),
        Band(slice(16, 304), slice(8, 312), sides),
        Band(slice(304, 320), slice(296, 320), whole),
    ]


def test_scattered_pixels_share_a_band():
    """Separate bands would have more halos."""
    needed = np.zeros((320, 320), bool)
    needed[:64:16, :64:16] = True
    assert cover(needed, 8) == [Band(slice(0, 56), slice(0, 64), (slice(0, 64),))]


def test_distant_pixels_have_bands_of_their_own():
    needed = np.zeros((320, 320), bool)
    needed[3, 5] = needed[300, 250] = True
    assert cover(needed, 8) == [
        Band(slice(0, 8), slice(0, 16), (slice(0, 16),)),
        Band(slice(296, 304), slice(288, 312), (slice(240, 264),)),
    ]
