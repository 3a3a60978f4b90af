"""Short outlines: regions whose gain minus the cost of their outline is largest."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from jotlight.motion.outlines.short_outlines import shortest_outlines

REGIONS = np.array(list(itertools.product((False, True), repeat=12))).reshape(-1, 3, 4)
"""All regions of 3 x 4 pixels."""


def twin(gain, length):
    """Return the pixels as the engine does, in NumPy."""
    length = np.float32(length)
    step, dual = np.float32(0.35) / length, length / (8 * np.float32(0.35))
    inside = (gain > 0).astype(np.float32)
    ahead = inside.copy()
    flow = np.zeros((2, *gain.shape), np.float32)
    for _ in range(150):
        flow[0, :-1] += dual * (ahead[1:] - ahead[:-1])
        flow[1, :, :-1] += dual * (ahead[:, 1:] - ahead[:, :-1])
        flow /= np.maximum(1, np.sqrt(flow[0] ** 2 + flow[1] ** 2) / length)
        divergence = flow[0] + flow[1]
        divergence[1:] -= flow[0, :-1]
        divergence[:, 1:] -= flow[1, :, :-1]
        before = inside
        inside = np.clip(before + step * divergence + step * gain, 0, 1)
        ahead = 2 * inside - before
    return inside > 0.5


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 1), (40, 33)])
def test_the_pixels_are_those_of_a_twin(shape, threads):
    gain = np.random.default_rng(4).normal(-0.1, 2, shape).astype(np.float32)
    for length in (0.4, 2.0):
        found = shortest_outlines(gain, length, threads)
        np.testing.assert_array_equal(found, twin(gain, length))


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


@pytest.mark.parametrize("length", [0.0, -1.0, np.nan, np.inf])
def test_a_length_must_be_a_number_above_0(length):
    with pytest.raises(ValueError, match="length: expected a number above 0"):
        shortest_outlines(np.zeros((2, 3), np.float32), length)
