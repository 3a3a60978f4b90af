"""Sums of counts along a motion: added, selected, and masked."""

import numpy as np
import pytest

import jotlight as jl
from jotlight import _engine as engine
from jotlight.motion.counts.sums import Sums
from moving import blocks_of
from reference import motion as reference


def test_sums_can_be_added():
    rng = np.random.default_rng(6)
    bits = jl.Bits.from_array(rng.random((12, 20, 30)) < 0.3)
    blocks = blocks_of(bits, 1)
    fields = tuple(rng.normal(0, 3, (2, 2, 2, 2)))
    parts = [blocks.count(frames, fields, (0, 12)) for frames in (range(5), range(5, 12))]
    whole = blocks.count(range(12), fields, (0, 12))
    for total in (parts[0] + parts[1], Sums.total(parts)):
        np.testing.assert_array_equal(total.ones, whole.ones)
        np.testing.assert_array_equal(total.trials, whole.trials)
        np.testing.assert_allclose(total.remainders, whole.remainders, atol=1e-4)
        assert total.frames == 12


def test_totals_have_arrays_of_their_own():
    blocks = blocks_of(jl.Bits.from_array(np.ones((6, 20, 30), bool)), 1)
    part = blocks.count(range(6), np.zeros((2, 2, 2, 2)), (0, 6))
    total = Sums.total([part])
    total += part
    assert (part.ones == 6).all()
    assert (total.ones == 12).all()


def test_totals_of_nothing_need_a_size():
    assert not Sums.total([], size=(2, 3)).trials.any()
    with pytest.raises(ValueError, match="parts: expected one or more, or their size"):
        Sums.total([])


def test_pixels_are_selected_from_several_sums():
    rng = np.random.default_rng(7)
    blocks = blocks_of(jl.Bits.from_array(rng.random((6, 20, 50)) < 0.3), 1)
    fields = rng.normal(0, 3, (3, 2, 2, 4))
    parts = [blocks.count(range(6), (field, field), (0, 6)) for field in fields]
    labels = rng.integers(0, 3, (20, 50), np.uint8)
    chosen = Sums.select(parts, labels)
    assert chosen.frames == 6
    for name in ("ones", "trials"):
        expected = np.choose(labels, [getattr(part, name) for part in parts])
        np.testing.assert_array_equal(getattr(chosen, name), expected)
    expected = np.zeros((20, 2, 4))
    for row in range(20):
        for number in range(4):
            columns = labels[row, 16 * number : 16 * number + 16]
            for label in columns:
                expected[row, :, number] += parts[label].remainders[row, :, number] / len(columns)
    np.testing.assert_allclose(chosen.remainders, expected, atol=1e-5)


def test_masked_sums_have_no_trials_elsewhere():
    rng = np.random.default_rng(8)
    blocks = blocks_of(jl.Bits.from_array(rng.random((6, 20, 30)) < 0.3), 1)
    field = np.zeros((2, 2, 2))
    sums, kept = blocks.count(range(6), (field, field), (0, 6)), rng.random((20, 30)) < 0.5
    np.testing.assert_array_equal(sums.masked(kept).ones, np.where(kept, sums.ones, 0))
    np.testing.assert_array_equal(sums.masked(kept).trials, np.where(kept, 6, 0))


@pytest.mark.parametrize("threads", [1, None])
@pytest.mark.parametrize("size", [(1, 1), (20, 30), (70, 129)])
def test_accepted_pixels_are_added(size, threads):
    rng = np.random.default_rng(10)
    parts = [Sums.zeros(size) for _ in range(3)]
    for part in parts:
        part.trials = rng.integers(0, 100, size, np.int32)
        part.ones = rng.integers(0, part.trials + 1).astype(np.int32)
        part.remainders += rng.normal(size=part.remainders.shape).astype(np.float32)
        part.frames = 100
    total = Sums.total(iter(parts))
    for name in ("ones", "trials", "frames"):
        expected = sum(getattr(part, name) for part in parts)
        np.testing.assert_array_equal(getattr(total, name), expected)
    before, test = parts[0] + parts[1], rng.random(size).astype(np.float32)
    mask = np.full((size[0], -(-size[1] // 8)), 7, np.uint8)
    total.add_accepted(before, test, 0.4, mask, threads)
    kept = before.masked(test < np.float32(0.4))
    np.testing.assert_array_equal(mask, np.packbits(test < np.float32(0.4), axis=1))
    np.testing.assert_array_equal(total.ones, sum(part.ones for part in parts) + kept.ones)
    np.testing.assert_array_equal(total.trials, sum(part.trials for part in parts) + kept.trials)
    assert total.frames == 500


@pytest.mark.parametrize("size", [(1, 1), (16, 40), (50, 33)])
def test_remainders_along_a_changed_motion_are_those_of_the_twin(size):
    rng = np.random.default_rng(0)
    sums = Sums.zeros(size)
    sums.remainders[:], sums.frames = rng.normal(0, 3, sums.remainders.shape), 7
    change = rng.normal(size=(2, -(-size[0] // 16), -(-size[1] // 16)))
    expected = reference.changed_remainders(sums.remainders, change, 7)
    np.testing.assert_allclose(sums.seen_along(change).remainders, expected, atol=1e-5)
    with pytest.raises(ValueError, match="change of tiles: expected"):
        sums.seen_along(np.zeros((2, 9, 1)))


def test_sums_of_other_shapes_are_refused():
    small, large = Sums.zeros((4, 9)), Sums.zeros((4, 10))
    test, mask = np.zeros((4, 9), np.float32), np.zeros((4, 2), np.uint8)
    with pytest.raises(ValueError, match="counts: expected"):
        engine.add_counts([large.ones], small.ones, None)
    with pytest.raises(ValueError, match="counts: expected"):
        small.add_accepted(large, test, 1, mask)
    with pytest.raises(ValueError, match="packed mask: expected"):
        small.add_accepted(Sums.zeros((4, 9)), test, 1, mask[:, :1].copy())
