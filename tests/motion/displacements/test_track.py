"""Tracks and paths: counts along displacements that change between and within blocks."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.counts import kept_sums
from jotlight.motion.displacements.track import Paths, Track, from_center
from jotlight.motion.tiles import tile_counts
from moving import blocks_of
from reference.motion import interpolate_tiles, shifted_counts

SIZE = 40, 56
FRAMES = 24


def random_track(number, known=None, seed=0):
    rng = np.random.default_rng(seed)
    bits = rng.random((FRAMES, *SIZE)) < 0.4
    blocks = blocks_of(jl.Bits.from_array(bits), number)
    nodes = rng.normal(0, 4, (number, 2, 1, 1)) + rng.normal(0, 1, (number, 2, *tile_counts(SIZE)))
    known = np.ones(number, bool) if known is None else np.array(known)
    information = np.zeros((number, 3, *tile_counts(SIZE)))
    return Track(blocks, 12, nodes, known, information), bits


def expected_sums(track, bits, block, others):
    """Return ones and trials of a block, frame by frame, and which pixels rounding decides."""
    centers, edges = track.blocks.centers, track.blocks.edges
    ones, trials, unclear = np.zeros(SIZE, int), np.zeros(SIZE, int), np.zeros(SIZE, bool)
    for frame in range(edges[block], edges[block + 1]):
        other = others[0] if frame < centers[block] else others[1]
        share = (frame - centers[block]) / (centers[other] - centers[block])
        nodes = track.nodes[block] + share * (track.nodes[other] - track.nodes[block])
        field = interpolate_tiles(nodes.astype(np.float32), 16, SIZE)
        unclear |= (abs(abs(field - np.floor(field)) - 0.5) < 1e-4).any(axis=0)
        found = shifted_counts(bits[frame : frame + 1], field, field, None, [0])
        ones, trials = ones + found[0], trials + found[1]
    return ones, trials, unclear


@pytest.mark.parametrize(
    ("number", "known", "block", "others"),
    [
        (6, None, 2, (1, 3)),
        (6, None, 0, (1, 1)),
        (6, None, 5, (4, 4)),
        (5, None, 2, (1, 3)),
        (6, [False, False, False, True, True, False], 2, (3, 3)),
        (6, [False, False, True, True, False, False], 4, (3, 3)),
    ],
)
def test_displacements_are_interpolated_between_known_blocks(number, known, block, others):
    track, bits = random_track(number, known)
    ones, trials, unclear = expected_sums(track, bits, block, others)
    sums = track.sums(block)
    assert unclear.mean() < 0.01
    np.testing.assert_array_equal(sums.ones[~unclear], ones[~unclear])
    np.testing.assert_array_equal(sums.trials[~unclear], trials[~unclear])
    assert sums.frames == track.blocks.edges[block + 1] - track.blocks.edges[block]


def test_one_block_has_one_displacement():
    track, bits = random_track(1)
    field = interpolate_tiles(track.nodes[0].astype(np.float32), 16, SIZE)
    ones, trials, _ = shifted_counts(bits, field, field, None, np.zeros(FRAMES))
    np.testing.assert_array_equal(track.sums(0).trials, trials)
    np.testing.assert_array_equal(track.sums(0).ones, ones)


def test_whole_shifts_in_each_frame_give_the_sum_of_shifted_frames():
    """The scene moves by 1 row and -2 columns in each frame."""
    rng = np.random.default_rng(1)
    bits = rng.random((FRAMES, *SIZE)) < 0.4
    blocks = blocks_of(jl.Bits.from_array(bits), 6)
    nodes = np.zeros((6, 2, *tile_counts(SIZE)))
    nodes += np.outer(blocks.centers - 12, (1, -2))[:, :, None, None]
    track = Track(blocks, 12, nodes, np.ones(6, bool), np.zeros((6, 3, 1, 1)))
    ones, trials = np.zeros(SIZE, int), np.zeros(SIZE, int)
    for frame in range(FRAMES):
        for row, column in np.ndindex(*SIZE):
            y, x = row + (frame - 12), column - 2 * (frame - 12)
            if 0 <= y < SIZE[0] and 0 <= x < SIZE[1]:
                ones[row, column] += bits[frame, y, x]
                trials[row, column] += 1
    total = np.sum([(track.sums(n).ones, track.sums(n).trials) for n in range(6)], axis=0)
    np.testing.assert_array_equal(total[0], ones)
    np.testing.assert_array_equal(total[1], trials)


@pytest.mark.parametrize("change", [0.0, 0.03, 2.0])
@pytest.mark.parametrize("step", [1, 2])
def test_exact_tracks_count_along_their_own_displacements(change, step):
    """Sums that were counted along other displacements, however near, are counted again."""
    track, _ = random_track(6)
    track = track.over(dataclasses.replace(track.blocks, step=step))
    for block in range(6):
        track.sums(block)
    track.nodes += change
    exact = track.exact(dataclasses.replace(track.blocks, step=1))
    nodes = track.nodes.astype(np.float32)
    np.testing.assert_array_equal(exact.nodes, nodes)
    fresh = Track(exact.blocks, 12, nodes.astype(float), track.known, track.information)
    for block in range(6):
        for name in ("ones", "trials", "remainders"):
            expected = getattr(fresh.sums(block), name)
            np.testing.assert_array_equal(getattr(exact.sums(block), name), expected)


def test_each_pixel_counts_along_its_own_track():
    (one, _), (other, _) = random_track(6), random_track(6)
    other.nodes = other.nodes[::-1].copy()
    labels = np.random.default_rng(2).integers(0, 2, SIZE, np.uint8)
    paths = Paths([one, other], labels, free=1)
    for name in ("ones", "trials"):
        expected = np.where(labels == 1, getattr(other.sums(3), name), getattr(one.sums(3), name))
        np.testing.assert_array_equal(getattr(paths.sums(3), name), expected)
    expected = np.where(labels == 1, other.displacements(3), one.displacements(3))
    np.testing.assert_array_equal(paths.displacements(3), expected)
    assert paths.reference == 12
    assert Paths([one], labels * 0).sums(3).ones.tolist() == one.sums(3).ones.tolist()


def test_a_part_of_the_pixels_is_counted_along_the_same_motion():
    track, _ = random_track(6)
    pixels = np.random.default_rng(3).random(SIZE) < 0.5
    part = track.inside(pixels)
    for name in ("ones", "trials"):
        expected = np.where(pixels, getattr(track.sums(2), name), 0)
        np.testing.assert_array_equal(getattr(part.sums(2), name), expected)
        np.testing.assert_array_equal(getattr(part.nearby_sums(2), name), expected)
    whole = part.inside(None)
    np.testing.assert_array_equal(whole.sums(2).trials, track.sums(2).trials)
    assert whole.nodes is track.nodes


@pytest.mark.parametrize(("reference", "expected"), [(12, [3, 2, 4, 1, 5, 0]), (0, [*range(6)])])
def test_blocks_are_ordered_by_their_distance_from_the_reference(reference, expected):
    track, _ = random_track(6)
    track.reference = reference
    assert from_center(track).tolist() == expected


def test_counted_blocks_are_kept_until_their_displacements_change(monkeypatch):
    track, _ = random_track(6)
    first = track.sums(2)
    assert track.sums(2) is first
    track.nodes[3] += 0.7  # a neighbor, toward which the displacements change
    changed = track.sums(2)
    assert changed is not first
    fresh = Track(track.blocks, 12, track.nodes, track.known, track.information)
    np.testing.assert_array_equal(changed.ones, fresh.sums(2).ones)
    np.testing.assert_array_equal(changed.remainders, fresh.sums(2).remainders)
    monkeypatch.setattr(kept_sums, "_MAX_KEPT_BYTES", 0)
    assert fresh.sums(3) is not fresh.sums(3)


def test_nearby_sums_have_the_remainders_of_the_new_displacements():
    track, _ = random_track(6)
    before = track.sums(2)
    track.nodes += np.random.default_rng(1).uniform(-0.2, 0.2, (1, 2, *track.nodes.shape[2:]))
    nearby, exact = (
        track.nearby_sums(2),
        Track(track.blocks, 12, track.nodes, track.known, track.information).sums(2),
    )
    np.testing.assert_array_equal(nearby.ones, before.ones)
    # Shift minus displacement: counting again may round the shift of some bits otherwise.
    shifted = nearby.remainders - before.remainders
    rounded = exact.remainders - before.remainders - shifted
    assert abs(shifted).max() > 0.3
    assert abs(rounded / before.frames).max() < 1.01
    track.nodes[2] += 5
    np.testing.assert_array_equal(track.nearby_sums(2).ones, track.sums(2).ones)
    assert (track.nearby_sums(2).ones != before.ones).any()
