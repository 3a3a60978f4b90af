"""Short outlines: regions whose gain minus the cost of their outline is largest."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from jotlight.motion.short_outlines import shortest_outlines

REGIONS = np.array(list(itertools.product((False, True), repeat=12))).reshape(-1, 3, 4)
"""All regions of 3 x 4 pixels."""


def net_gain(gain, pixels, length):
    """Return the gain of regions (..., H, W) minus the cost of their outlines."""
    values = pixels.astype(float)
    down = np.diff(values, axis=-2, append=values[..., -1:, :])
    right = np.diff(values, axis=-1, append=values[..., -1:])
    return (gain * values - length * np.hypot(down, right)).sum((-2, -1))


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(
    arrays(np.float32, (3, 4), elements=st.floats(-4, 4, width=16)),
    st.sampled_from([0.3, 1.0, 2.5]),
)
def test_no_other_region_gains_clearly_more(gain, length):
    """All 4,096 regions are tried. Diagonal steps make the best one less than exact."""
    best = net_gain(gain, REGIONS, length).max()
    found = shortest_outlines(gain, length)
    assert found.shape == (3, 4)
    assert found.dtype == bool
    assert net_gain(gain, found, length) >= best - 0.6 * length


def test_noise_has_no_outlines_but_a_disk_with_the_same_noise_has():
    rng = np.random.default_rng(0)
    rows, columns = np.indices((64, 80)) - np.array([30, 40]).reshape(2, 1, 1)
    disk = np.hypot(rows, columns) < 18
    noise = rng.normal(0, 1, disk.shape)
    alone = shortest_outlines((noise - 0.5).astype(np.float32), 2.0)
    found = shortest_outlines((noise - 0.5 + disk).astype(np.float32), 2.0)
    assert alone.mean() < 0.01
    assert (found != disk).mean() < 0.03


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 1)])
def test_thin_images_are_possible(shape):
    assert shortest_outlines(np.full(shape, 0.1, np.float32), 2.0).all()
    assert not shortest_outlines(np.full(shape, -0.1, np.float32), 2.0).any()


def test_a_hole_without_gain_is_filled_if_its_outline_costs_more():
    gain = np.full((24, 24), -1, np.float32)
    gain[4:20, 4:20] = 2
    gain[9:15, 9:15] = 0
    expected = np.zeros((24, 24), bool)
    expected[4:20, 4:20] = True
    found = shortest_outlines(gain, 1.0)
    assert (found != expected).sum() <= 8  # corners may be rounded
    assert found[9:15, 9:15].all()
