"""Sums that are kept: how far curves are apart, and what is counted again."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.counts.kept_sums import Curve, KeptSums, keeps_sums
from jotlight.motion.tiles import tile_counts
from moving import blocks_of

SIZE = 32, 48
TILES = 2, *tile_counts(SIZE)
BLOCKS = blocks_of(jl.Bits.from_array(np.random.default_rng(0).random((24, *SIZE)) < 0.4), 4)


def curve(fields=2, shift=0.5):
    """Return a curve of the second block, whose frames are 6 to 11."""
    times = np.linspace(2.5, 2.5 + 6 * (fields - 1), fields)
    return Curve(range(6, 12), np.full((fields, *TILES), shift), times)


def test_curves_through_different_fields_are_never_the_same():
    """A block whose neighbors are not known may move alike, but is interpolated in another way."""
    three, two = curve(3), curve(2)
    assert three.distance(three) == 0
    assert 0 < two.distance(three) < 1e-9
    assert curve(2, 0.75).distance(three) == pytest.approx(0.25)


def test_the_mean_of_a_curve_is_that_of_its_frames():
    found = dataclasses.replace(curve(), fields=np.stack([np.zeros(TILES), np.ones(TILES)]))
    np.testing.assert_allclose(found.mean, (np.arange(6, 12).mean() - 2.5) / 6)


def test_sums_are_seen_along_curves_that_are_near():
    kept, counted = KeptSums(), curve()
    sums = BLOCKS.count(counted.frames, counted.fields, counted.times)
    assert kept.seen_along(1, counted, 0.5) is None
    kept.keep(1, counted, sums)
    assert kept.seen_along(1, curve(), 0.0) is sums
    assert kept.seen_along(2, counted, 0.5) is None
    near = curve(shift=0.75)
    assert kept.seen_along(1, near, 0.2) is None
    seen = kept.seen_along(1, near, 0.3)
    assert seen.ones is sums.ones
    # The remainders are sums over 6 frames of the shift minus the displacement.
    np.testing.assert_allclose(seen.remainders, sums.remainders - 6 * 0.25, atol=1e-5)
    # The same curve again has the same sums, unless they were counted too far away.
    assert kept.seen_along(1, curve(shift=0.75), 0.3) is seen
    assert kept.seen_along(1, near, 0.2) is None
    # A curve that is near the one seen last, but not the one that was counted.
    assert kept.seen_along(1, curve(shift=1.0), 0.3) is None
    later = BLOCKS.count(near.frames, near.fields, near.times)
    kept.keep(1, near, later)
    assert kept.seen_along(1, near, 0.0) is later


def test_sums_of_large_images_are_not_kept():
    assert keeps_sums((1024, 1024), 32)
    assert not keeps_sums((1024, 1024), 33)
    assert not keeps_sums((1024, 1024), 32, jots_differ=True)
