"""Stricter tests of bits near others that disagree: scenes whose wrong bits are known."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import jotlight as jl
from jotlight.motion.agreement.consistency import find_consistent
from jotlight.motion.agreement.stricter_test import select_bits
from jotlight.motion.align import as_motion
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.films import merging as film_merging
from jotlight.motion.films.memory import Memory
from jotlight.motion.films.merging import FilmMerging
from jotlight.motion.merge import as_paths
from moving import blocks_of

SIZE, FRAMES = (64, 96), 64


def crossing(seed, light=1.0):
    """Return the bits of a still scene in front of which something crosses, and where it is."""
    rng = np.random.default_rng(seed)
    p = np.full((FRAMES, *SIZE), 0.1)
    p[:, ::4] = 0.3
    rows, columns = np.indices(SIZE)
    center = 10 + 50 * np.arange(FRAMES)[:, None, None] / FRAMES
    hidden = (abs(rows - 24 - 8 * np.sin(center / 6)) < 10) & (abs(columns - center) < 9)
    p[hidden] = 0.24
    return rng.random(p.shape) < light * p, hidden


def still_track(bits, threads=None):
    """Return the track of a scene that stands still."""
    blocks = dataclasses.replace(blocks_of(jl.Bits.from_array(bits)), threads=threads)
    return Track.still(blocks)


def select(bits, threads=None):
    """Return the track of a still scene, what agrees with it, and what is counted."""
    track = still_track(bits, threads)
    consistent = find_consistent(track)
    return track, consistent, select_bits(track, consistent)


def masks_of(consistent, track):
    """Return which bits are counted, (T, H, W)."""
    frames = np.diff(track.blocks.edges)
    masks = np.unpackbits(consistent.masks, axis=2, count=SIZE[1]).astype(bool)
    return masks.repeat(frames, axis=0)


def test_fewer_bits_of_what_moves_are_counted_and_hardly_fewer_others():
    counted_wrong, lost = [], []
    for seed in range(3):
        bits, hidden = crossing(seed)
        track, *both = select(bits)
        usual, strict = (masks_of(each, track) for each in both)
        assert not (strict & ~usual).any()
        counted_wrong.append((strict & hidden).sum() / (usual & hidden).sum())
        lost.append((usual & ~strict & ~hidden).sum() / (usual & ~hidden).sum())
    assert np.mean(counted_wrong) < 0.7
    assert np.mean(lost) < 0.1


def test_the_sums_are_those_of_the_counted_bits():
    bits, _ = crossing(5)
    track, consistent, counted = select(bits)
    masks = masks_of(counted, track)
    assert masks.sum() < masks_of(consistent, track).sum()
    is_after = (track.blocks.centers > track.reference).repeat(np.diff(track.blocks.edges))
    for sums, frames in ((counted.before, ~is_after), (counted.after, is_after)):
        np.testing.assert_array_equal(sums.ones, (bits & masks)[frames].sum(axis=0))
        np.testing.assert_array_equal(sums.trials, masks[frames].sum(axis=0))
    np.testing.assert_allclose(counted.accepted, masks.mean(axis=0), rtol=1e-6)


def test_stricter_tests_decide_where_more_than_12_and_20_percent_are_rejected():
    bits, _ = crossing(6)
    track, *both = select(bits)
    stricter = (find_consistent(track, limits=each) for each in ((1.5, 1.2), (1.2, 1.05)))
    usual, counted, strict, strictest = (
        np.unpackbits(each.masks, axis=2, count=SIZE[1]).astype(bool) for each in (*both, *stricter)
    )
    squares = (~usual).reshape(len(usual), SIZE[0] // 4, 4, SIZE[1] // 4, 4).mean(axis=(2, 4))
    nearby = gaussian_filter(squares, 2.0, mode=("nearest", "reflect", "reflect"))
    nearby = nearby.repeat(4, axis=1).repeat(4, axis=2)
    for pixels, expected in (
        (nearby < 0.11, usual),
        ((nearby > 0.13) & (nearby < 0.19), usual & strict),
        (nearby > 0.21, usual & strict & strictest),
    ):
        assert pixels.any()
        np.testing.assert_array_equal(counted[pixels], expected[pixels])


def test_where_all_bits_agree_nothing_is_tested_again(monkeypatch):
    track = still_track(np.zeros((FRAMES, *SIZE), bool))
    consistent = find_consistent(track)
    monkeypatch.setattr("jotlight.motion.agreement.stricter_test.find_consistent", None)
    assert select_bits(track, consistent) is consistent


def test_chance_alone_hardly_removes_bits():
    lost = []
    for seed in range(5):
        bits = np.random.default_rng(seed).random((FRAMES, *SIZE)) < 0.2
        _, consistent, counted = select(bits)
        lost.append(1 - counted.total.trials.sum() / consistent.total.trials.sum())
    assert np.mean(lost) < 0.01


def test_what_appears_matters_for_the_blocks_before_it_alone():
    """The bits after it agree with each other, so a stricter test would only waste some."""
    p = np.full((FRAMES, *SIZE), 0.1)
    p[:, ::4] = 0.3
    p[20:, 16:48, 20:60] = 0.5
    removed = []
    for seed in range(4):
        bits = np.random.default_rng(seed).random(p.shape) < p
        track, *both = select(bits)
        usual, strict = (masks_of(each, track) for each in both)
        removed.append((usual & ~strict).mean(axis=(1, 2)))
    by_time = np.mean(removed, axis=0)
    assert by_time[:20].mean() > 5 * by_time[44:].mean()


def test_the_number_of_threads_changes_nothing():
    bits, _ = crossing(8)
    one, two = (select(bits, threads)[2] for threads in (1, 2))
    np.testing.assert_array_equal(one.masks, two.masks)
    np.testing.assert_array_equal(one.total.ones, two.total.ones)


@pytest.mark.parametrize("cut", [(64, 93), (61, 90), (50, 65)])
def test_all_sizes_are_possible(cut):
    bits, _ = crossing(9)
    bits = np.ascontiguousarray(bits[:, : cut[0], : cut[1]])
    track, consistent, counted = select(bits)
    masks = np.unpackbits(counted.masks, axis=2, count=cut[1]).astype(bool)
    masks = masks.repeat(np.diff(track.blocks.edges), axis=0)
    np.testing.assert_array_equal(counted.total.ones, (bits & masks).sum(axis=0))
    assert (counted.total.trials <= consistent.total.trials).all()
    assert counted.total.trials.sum() < consistent.total.trials.sum()


def test_merging_counts_the_selected_bits():
    bits, _ = crossing(10)
    track, consistent, counted = select(bits)
    paths = Paths([track], np.zeros(SIZE, np.uint8))
    merging = FilmMerging(jl.Sensor(frames=FRAMES), 8, may_stand_still=False)
    found = merging.merge(paths, as_motion(paths, "affine"), 0, None)
    assert consistent.total.trials.sum() > counted.total.trials.sum()
    np.testing.assert_array_equal(found.merged.ones, counted.total.ones)
    np.testing.assert_array_equal(found.merged.trials, counted.total.trials)
    np.testing.assert_allclose(found.merged.acceptance, counted.accepted)
    assert found.agreeing == pytest.approx(consistent.accepted.mean())
    np.testing.assert_array_equal(found.counted.masks, counted.masks)


def test_a_film_remembers_the_selected_bits(monkeypatch):
    bits, _ = crossing(11)
    track, _, counted = select(bits)
    paths, remembered = Paths([track], np.zeros(SIZE, np.uint8)), []
    leaving = film_merging.sum_leaving

    def spy(paths, consistent, *others):
        remembered.append(consistent.masks)
        return leaving(paths, consistent, *others)

    monkeypatch.setattr(film_merging, "sum_leaving", spy)
    merging = FilmMerging(jl.Sensor(frames=FRAMES), 8, may_stand_still=False)
    merging.merge(paths, as_motion(paths, "affine"), 0, Memory(FRAMES))
    np.testing.assert_array_equal(remembered[0], counted.masks)


@pytest.mark.slow
def test_nothing_moves_by_itself_in_a_clear_scene_with_one_motion():
    sensor = jl.Sensor(frames=64)
    scene = jl.datasets.moving(motion="shake", sensor=sensor, shape=(96, 128), photons=1.0, rng=0)
    motion = jl.align(scene.bits)
    consistent = find_consistent(as_paths(motion, blocks_of(scene.bits)))
    merged = jl.merge(scene.bits, motion=motion)
    np.testing.assert_array_equal(merged.ones, consistent.total.ones)
    # A stricter test would reject some bits at steep edges.
    counted = select_bits(as_paths(motion, blocks_of(scene.bits)), consistent)
    assert counted.total.trials.sum() < consistent.total.trials.sum()
