"""Depth: objects in front of a background, their outlines, and what they hide."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.displacements.scoring import make_template
from jotlight.motion.displacements.track import Paths, from_center
from jotlight.motion.outlines import depth
from jotlight.motion.outlines.depth import (
    Gain,
    object_gains,
    order_by_depth,
    refine_outlines,
    without_absent,
)
from jotlight.motion.tiles import interpolate, tile_counts
from moving import blocks_of, occluded, record, track_of

SIZE = 40, 56
FRAMES = 32


def square(top, left, side):
    mask = np.zeros(SIZE, bool)
    mask[top : top + side, left : left + side] = True
    return mask


VELOCITIES = (0, 0), (0, 1), (1, 0)
MASKS = np.ones(SIZE, bool), square(10, 12, 16), square(4, 36, 10)


def scene_of(number):
    """Return the paths of the first planes with true labels, and what each pixel shows."""
    bits, shown = occluded(VELOCITIES[:number], MASKS[:number])
    blocks = blocks_of(bits, FRAMES)  # one frame per block, so that all is exact
    labels = np.zeros(SIZE, np.uint8)
    for index in range(1, number):
        labels[MASKS[index]] = index
    tracks = [track_of(blocks, each, FRAMES // 2) for each in VELOCITIES[:number]]
    return Paths(tracks, labels), shown


def test_hidden_pixels_are_not_counted():
    paths, shown = scene_of(3)
    rows, columns = np.indices(SIZE)
    for block in (0, 9, FRAMES - 1):
        sums = paths.sums(block)
        for index, velocity in enumerate(VELOCITIES):
            row, column = (
                grid + (block - FRAMES // 2) * speed
                for grid, speed in zip((rows, columns), velocity, strict=True)
            )
            seen = (row >= 0) & (row < SIZE[0]) & (column >= 0) & (column < SIZE[1])
            seen &= shown[block][row.clip(0, SIZE[0] - 1), column.clip(0, SIZE[1] - 1)] == index
            own = paths.labels == index
            np.testing.assert_array_equal(sums.trials[own], seen[own])


def test_each_pixel_has_bits_near_the_reference_time():
    paths, _ = scene_of(2)
    paths.labels[18, 20] = 0  # a hole that the object hides before and after
    central = [paths.sums(int(block)).trials for block in from_center(paths)[:2]]
    assert np.sum(central, axis=0).min() >= 1
    assert paths.sums(13).trials[18, 20] == 0


def test_free_tracks_hide_nothing():
    paths, _ = scene_of(2)
    free = dataclasses.replace(paths, free=1)
    assert not free.covered(0, 3).any()
    assert paths.covered(0, 3).sum() == 16 * 16 - 16  # a column of the object has left the view
    background = paths.labels == 0
    np.testing.assert_array_equal(
        free.sums(3).trials[background], paths.tracks[0].sums(3).trials[background]
    )


def test_pixels_at_the_same_position_are_as_far_as_the_tracks_have_moved_apart():
    paths, _ = scene_of(3)
    nodes = paths.relative(2, 1, 3)
    assert nodes.shape == (2, *tile_counts(SIZE))
    np.testing.assert_allclose(nodes[0], 3 - FRAMES // 2, atol=1e-5)
    np.testing.assert_allclose(nodes[1], FRAMES // 2 - 3, atol=1e-5)


@pytest.mark.parametrize("threads", [1, 2])
def test_covered_pixels_are_those_at_the_rounded_positions_of_segments_in_front(threads):
    """A loop over segments yields the same, with displacements between the centers of tiles."""
    rng = np.random.default_rng(3)
    paths, _ = scene_of(3)
    blocks = dataclasses.replace(paths.blocks, threads=threads)
    for track in paths.tracks:
        track.blocks = blocks
        track.nodes += rng.normal(0, 3, track.nodes.shape)
    paths.labels = rng.integers(0, 3, SIZE, dtype=np.uint8)
    expected = np.zeros(SIZE, bool)
    for front in (1, 2):
        moved = np.indices(SIZE) + np.rint(interpolate(paths.relative(0, front, 5), SIZE))
        inside = ((moved >= 0) & (moved < np.reshape(SIZE, (2, 1, 1)))).all(axis=0)
        rows, columns = np.where(inside, moved, 0).astype(int)
        expected |= inside & (paths.labels[rows, columns] == front)
    np.testing.assert_array_equal(paths.covered(0, 5), expected)


@pytest.mark.slow
def test_gains_are_sums_of_log_likelihood_differences(monkeypatch):
    """A loop over blocks and pixels yields the same, without the loss by noise."""
    monkeypatch.setattr(depth, "_NOISE", 0.0)
    paths, _ = scene_of(2)
    (gain,) = object_gains(paths)
    expected = np.zeros(SIZE)
    known, every = np.zeros(SIZE), np.zeros(SIZE)
    back, front = paths.tracks
    for half in (0, 1):
        others = range(1 - half, FRAMES, 2)
        templates, trials = [], None
        for index, track in enumerate((back, front)):
            parts = [track.sums(block) for block in others]
            if index == 0:
                seen = [~paths.covered(0, block) for block in others]
                parts = [part.masked(mask) for part, mask in zip(parts, seen, strict=True)]
            total = sum(parts[1:], parts[0])
            templates.append(make_template(total, None).probability.astype(float))
            trials = total.trials if index == 0 else trials
        usual = np.median(trials)
        for block in range(half, FRAMES, 2):
            shift = block - FRAMES // 2
            sums = front.sums(block)
            for row, column in np.ndindex(*SIZE):
                every[row, column] += sums.trials[row, column]
                if not 0 <= column + shift < SIZE[1]:
                    continue
                p, q = templates[1][row, column], templates[0][row, column + shift]
                weight = min(1, 2 * trials[row, column + shift] / usual)
                ones = sums.ones[row, column]
                zeros = sums.trials[row, column] - ones
                term = ones * np.log(p / q) + zeros * np.log((1 - p) / (1 - q))
                expected[row, column] += weight * term
                known[row, column] += weight * sums.trials[row, column]
    np.testing.assert_allclose(gain.nats, expected, atol=2e-3)
    np.testing.assert_allclose(
        gain.known, np.where(every > 0, known / np.maximum(every, 1), 1), atol=1e-5
    )


def test_smooth_parts_belong_to_an_object_only_if_nothing_else_is_known_there():
    nats, known = np.full(SIZE, 0.1, np.float32), np.ones(SIZE, np.float32)
    nats[10:26, 12:28] = 6
    gain = Gain(nats, known)
    np.testing.assert_array_equal(gain.pixels(MASKS[1]), gain.pixels())
    assert (gain.pixels() != MASKS[1]).sum() <= 4  # corners may be rounded
    assert gain.net(MASKS[1]) == 6 * 16**2 - 2 * 4 * 16
    nats[14:22, 16:24] = known[14:22, 16:24] = 0
    unknown = Gain(nats, known)
    assert unknown.pixels()[14:22, 16:24].all()
    # Such pixels gain 0.3 nats.
    assert unknown.net(MASKS[1]) == pytest.approx(6 * (16**2 - 64) + 0.3 * 64 - 2 * 4 * 16)


@pytest.mark.parametrize("number", [2, 3])
def test_outlines_of_objects_are_found_from_a_wrong_guess(number):
    paths, _ = scene_of(number)
    guess = np.zeros(SIZE, np.uint8)
    for index in range(1, number):
        guess[np.roll(paths.labels == index, (3, -4), (0, 1))] = index
    found = refine_outlines(dataclasses.replace(paths, labels=guess))
    assert (found.labels != paths.labels).mean() < 0.4 * (guess != paths.labels).mean()


def test_an_object_that_does_not_exist_vanishes():
    bits, _ = occluded(VELOCITIES[:1], MASKS[:1])
    blocks = blocks_of(bits, FRAMES)
    tracks = [track_of(blocks, each, FRAMES // 2) for each in VELOCITIES[:2]]
    labels = MASKS[1].astype(np.uint8)
    assert not refine_outlines(Paths(tracks, labels)).labels.any()


def test_pixels_of_free_tracks_keep_them():
    paths, _ = scene_of(3)
    labels = paths.labels.copy()
    free = dataclasses.replace(paths, free=1, labels=labels)
    found = refine_outlines(free)
    np.testing.assert_array_equal(found.labels == 2, labels == 2)
    alone = dataclasses.replace(free, tracks=paths.tracks[::2], labels=(labels == 2).view(np.uint8))
    assert refine_outlines(alone) is alone


def test_objects_that_appear_later_are_left_out():
    paths, _ = scene_of(2)
    assert without_absent(paths) is paths
    there, _ = occluded(VELOCITIES[:2], MASKS[:2])
    before, _ = occluded(VELOCITIES[:1], MASKS[:1])
    frames = there.to_array()
    frames[: FRAMES // 2 + 6] = before.to_array()[: FRAMES // 2 + 6]
    blocks = blocks_of(jl.Bits.from_array(frames), FRAMES)
    tracks = [track_of(blocks, velocity, FRAMES // 2) for velocity in VELOCITIES[:2]]
    assert not without_absent(Paths(tracks, paths.labels)).labels.any()


@pytest.mark.slow
def test_the_outline_of_a_photographed_object_is_exact():
    scene, bits = record("layers", 64, shape=(128, 128), photons=0.3)
    paths = Paths([], np.zeros((128, 128), np.uint8))
    blocks = blocks_of(bits)
    shape = tile_counts(blocks.size)
    tracks = []
    for place in ((0, 0), (64, 64)):
        track = track_of(blocks, (0, 0), FRAMES // 2)
        track.nodes += np.stack(
            [scene.motion(time)[:, place[0], place[1], None, None] for time in blocks.centers]
        )
        tracks.append(track)
    is_object = abs(scene.motion(0) - scene.motion(0)[:, 64:65, 64:65]).sum(axis=0) < 1e-3
    guess = np.zeros(blocks.size, np.uint8)
    guess[24:104, 24:104] = 1
    found = refine_outlines(dataclasses.replace(paths, tracks=tracks, labels=guess))
    assert shape == (8, 8)
    assert ((found.labels == 1) != is_object).mean() < 0.02
    assert ((guess == 1) != is_object).mean() > 0.05


def test_large_segments_are_behind_small_ones():
    assert order_by_depth([5, 9, 9, 1]).tolist() == [1, 2, 0, 3]


def test_known_outlines_stay_where_the_bits_say_nothing():
    """A flat scene looks the same along all tracks; one with detail corrects wrong labels."""
    rng = np.random.default_rng(0)
    flat = blocks_of(jl.Bits.from_array(rng.random((FRAMES, *SIZE)) < 0.3), FRAMES // 8)
    labels = square(6, 8, 24).astype(np.uint8)
    paths = Paths([track_of(flat, each, FRAMES // 2) for each in VELOCITIES[:2]], labels)
    kept = refine_outlines(paths, are_known=True).labels
    assert (kept != labels).mean() < 0.01
    assert (refine_outlines(paths).labels != labels).mean() > 0.1
    clear, _ = scene_of(2)
    wrong = dataclasses.replace(clear, labels=square(12, 14, 16).astype(np.uint8))
    found = refine_outlines(wrong, are_known=True).labels
    assert (found != clear.labels).mean() < (wrong.labels != clear.labels).mean() / 2
