"""Parts of an image that contain the pixels of a map."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jotlight.networks.regions import cover, widen


@given(
    seed=st.integers(0, 10**6),
    density=st.sampled_from([0, 0.0003, 0.003, 0.1, 1]),
    height=st.integers(1, 200),
    width=st.integers(1, 200),
    halo=st.sampled_from([0, 3, 40]),
)
def test_regions_contain_all_needed_pixels_once(seed, density, height, width, halo):
    needed = np.random.default_rng(seed).random((height, width)) < density
    times = np.zeros(needed.shape, int)
    area = 0
    for region in cover(needed, halo):
        times[region] += 1
        rows, columns = widen(region, halo, needed.shape)
        area += (rows.stop - rows.start) * (columns.stop - columns.start)
    assert times.max(initial=0) <= 1
    assert (times[needed] == 1).all()
    assert area <= needed.size
    assert needed.any() or not times.any()


def test_a_border_has_four_regions():
    needed = np.zeros((320, 320), bool)
    needed[:5] = needed[-5:] = needed[:, :5] = needed[:, -5:] = True
    assert cover(needed, 8) == [
        (slice(0, 8), slice(0, 320)),
        (slice(8, 312), slice(0, 8)),
        (slice(8, 312), slice(312, 320)),
        (slice(312, 320), slice(0, 320)),
    ]


def test_scattered_pixels_share_large_cells():
    """Small cells would have more halos."""
    needed = np.zeros((320, 320), bool)
    needed[:64:16, :64:16] = True
    assert cover(needed, 8) == [(slice(0, 64), slice(0, 64))]


def test_a_halo_ends_at_the_border_of_the_image():
    assert widen((slice(32, 64), slice(0, 32)), 10, (70, 300)) == (slice(22, 70), slice(0, 42))
