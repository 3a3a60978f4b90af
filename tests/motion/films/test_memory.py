"""The bits from before the window of a film's image."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.agreement.consistency import Consistent
from jotlight.motion.counts.jots import Jots, SeenJots
from jotlight.motion.counts.sums import Sums
from jotlight.motion.films import memory as memory_module
from jotlight.motion.films.memory import Memory, remembers, sum_leaving
from jotlight.motion.merge import as_paths
from jotlight.motion.motion import Motion
from jotlight.motion.tiles import tile_counts
from jotlight.sensing.likelihood.reference import Jot
from moving import blocks_of

SIZE = 48, 64
FADING = np.exp(-8 / (2.5 * 32))
"""For 8 frames and a window of 32."""


def moved(displacements, *, labels=None, reference=16.0):
    """Return a motion whose fields move by some pixels from 8 frames earlier to the reference."""
    nodes = np.zeros((len(displacements), 2, 2, *tile_counts(SIZE)), np.float32)
    for field, displacement in enumerate(displacements):
        nodes[field, 0] = np.reshape(displacement, (2, 1, 1))
    labels = np.zeros(SIZE, np.uint8) if labels is None else labels
    information = np.ones((len(displacements), 2, 3, *tile_counts(SIZE)), np.float32)
    times = np.array([reference - 8, reference])
    model = "segments" if len(displacements) > 1 else "affine"
    return Motion(nodes, labels, times, reference, model, information)


def sums_of(probability, trials=32, rng=0):
    """Return random sums of bits with some probability (H, W)."""
    ones = np.random.default_rng(rng).binomial(trials, probability).astype(np.int32)
    sums = Sums.zeros(SIZE)
    return Sums(ones, np.full(SIZE, trials, np.int32), sums.remainders, trials)


def smooth_scene(shift=(0, 0)):
    """Return a probability at each pixel, displaced by whole pixels."""
    y, x = np.indices(SIZE) + np.reshape(shift, (2, 1, 1))
    return 0.4 + 0.2 * np.sin(y / 9) + 0.2 * np.cos(x / 7)


def remembered(old, motion):
    """Return a memory of sums that the image at frame 16 shows."""
    memory = Memory(window=32)
    memory.remember([old], motion, start=0)
    return memory


EVERY = np.ones(SIZE, bool)


@pytest.mark.parametrize("shift", [(0, 0), (3, -5), (-2, 4)])
def test_sums_are_displaced_by_whole_pixels_and_fade(shift, monkeypatch):
    monkeypatch.setattr(memory_module, "_MAX_DISAGREEMENT", np.inf)
    # The last image shows the point of pixel x at x + shift.
    motion = moved([shift])
    old, own = sums_of(smooth_scene(), rng=1), sums_of(smooth_scene(shift), rng=2)
    (total,) = remembered(old, motion).recall([own], EVERY, motion, start=8)
    rows, columns = (np.arange(n) + step for n, step in zip(SIZE, shift, strict=True))
    inside = np.ix_((rows >= 0) & (rows < SIZE[0]), (columns >= 0) & (columns < SIZE[1]))
    source = np.ix_(
        *(each[(each >= 0) & (each < n)] for each, n in zip((rows, columns), SIZE, strict=True))
    )
    trials, ones = own.trials.astype(float), own.ones.astype(float)
    trials[inside] += FADING * 32
    ones[inside] += FADING * old.ones[source]
    assert np.abs(total.ones - ones).max() <= 0.51
    np.testing.assert_allclose(total.ones / total.trials, ones / trials, rtol=1e-4)


def test_what_was_recalled_fades_again(monkeypatch):
    monkeypatch.setattr(memory_module, "_MAX_DISAGREEMENT", np.inf)
    old, own, motion = (
        sums_of(smooth_scene(), rng=1),
        sums_of(smooth_scene(), rng=2),
        moved([(0, 0)]),
    )
    memory = remembered(old, motion)
    memory.recall([own], EVERY, motion, start=8)
    memory.remember([Sums.zeros(SIZE)], motion, start=8)
    (again,) = memory.recall([own], EVERY, motion, start=16)
    expected = (own.ones + FADING**2 * old.ones) / (32 + FADING**2 * 32)
    np.testing.assert_allclose(again.ones / again.trials, expected, rtol=1e-4)


def test_pixels_that_disagree_and_their_neighbors_are_not_counted(monkeypatch):
    monkeypatch.setattr(memory_module, "_MAX_DISAGREEMENT", 2.0)
    motion = moved([(0, 0)])
    scene = 0.5 * smooth_scene() + 0.25
    changed = scene.copy()
    changed[:, 40:] += np.where(np.arange(40, SIZE[1]) // 8 % 2, 0.12, -0.12)
    memory = remembered(sums_of(scene, rng=1), motion)
    (total,) = memory.recall([sums_of(changed, rng=2)], EVERY, motion, start=8)
    assert (total.trials[:, 36:] == 32).all()
    assert (total.trials[:, :16] > 32).mean() > 0.8


def test_pixels_that_are_not_trusted_are_not_counted(monkeypatch):
    monkeypatch.setattr(memory_module, "_MAX_DISAGREEMENT", np.inf)
    motion, scene = moved([(0, 0)]), smooth_scene()
    trusted = np.ones(SIZE, bool)
    trusted[20, 30] = False
    memory = remembered(sums_of(scene, rng=1), motion)
    (total,) = memory.recall([sums_of(scene, rng=2)], trusted, motion, start=8)
    assert total.trials[20, 30] == 32
    assert (total.trials[trusted] > 32).all()


@pytest.fixture
def everything_agrees(monkeypatch):
    monkeypatch.setattr(memory_module, "_MAX_DISAGREEMENT", np.inf)
    monkeypatch.setattr(memory_module, "_MAX_CHANGE", np.inf)


def test_points_that_another_segment_hid_are_not_counted(everything_agrees):
    labels, before = np.zeros((2, *SIZE), np.uint8)
    labels[:, :24] = 1
    before[:, :32] = 1  # 8 columns further to the right
    motion, own = moved([(0, 0), (0, 0)], labels=labels), sums_of(smooth_scene(), rng=1)
    last = moved([(0, 0), (0, 0)], labels=before)
    (total,) = remembered(own, last).recall([own], EVERY, motion, start=8)
    assert (total.trials[:, 24:32] == 32).all()
    assert (total.trials[:, 40:] > 40).all()


def test_a_segment_stays_the_same_where_another_one_hides_most_of_it(everything_agrees):
    before, now = np.zeros((2, *SIZE), np.uint8)
    before[:, :36] = 1
    now[:, :12] = 1
    own, still = sums_of(smooth_scene(), rng=1), [(0, 0), (0, 0)]
    memory = remembered(own, moved(still, labels=before))
    (total,) = memory.recall([own], EVERY, moved(still, labels=now), start=8)
    assert (total.trials[:, 12:36] == 32).all()
    assert (total.trials[:, :4] > 40).all()


def test_a_fresh_motion_may_number_its_segments_differently(everything_agrees):
    before, now = np.zeros((2, *SIZE), np.uint8)
    before[:, :24] = 1
    now[:, 24:] = 1
    own, still = sums_of(smooth_scene(), rng=1), [(0, 0), (0, 0)]
    memory = remembered(own, moved(still, labels=before))
    (total,) = memory.recall([own], EVERY, moved(still, labels=now), start=8)
    assert (total.trials > 32).all()
    other = remembered(own, moved([(0, 0)]))
    assert other.recall([own], EVERY, moved(still, labels=now), start=8) == [own]


def test_nothing_is_recalled_from_before_the_window_or_after_the_motion_is_lost():
    motion, own = moved([(0, 0)]), sums_of(smooth_scene())
    memory = remembered(own, motion)
    assert memory.recall([own], EVERY, motion, start=17) == [own]
    memory = remembered(own, motion)
    memory.forget()
    assert memory.recall([own], EVERY, motion, start=8) == [own]


def test_what_the_bits_have_seen_of_the_jots_is_displaced():
    maps = np.ones((3, *SIZE), np.float32)
    maps[0] = 0.5 + np.arange(SIZE[1]) / 200
    jots = Jots(1, Jot(1.0, 0.0), maps)
    old, own = sums_of(smooth_scene(), rng=1), sums_of(smooth_scene((0, 2)), rng=1)
    for sums in (old, own):
        sums.jots = SeenJots(jots, maps[:2] * sums.trials)
    motion = moved([(0, 2)])
    (total,) = remembered(old, motion).recall([own], EVERY, motion, start=8)
    counted = total.trials[:, :-2] > 32
    assert counted.mean() > 0.5
    expected = (maps[0, :, :-2] + FADING * maps[0, :, 2:]) / (1 + FADING)
    found = total.jots.sums[0] / total.trials
    np.testing.assert_allclose(found[:, :-2][counted], expected[counted], rtol=1e-3)


@pytest.mark.parametrize("step", [5, 8, 12])
def test_the_first_frames_are_counted_once(step):
    rng = np.random.default_rng(4)
    bits = jl.Bits.from_array(rng.random((32, *SIZE)) < 0.3)
    masks = np.packbits(rng.random((4, *SIZE)) < 0.7, axis=2)
    blocks, motion = blocks_of(bits, 4), moved([(0, 0)])
    sums = Sums.zeros(SIZE)
    consistent = Consistent(sums, sums, np.ones(SIZE, np.float32), masks)
    (total,) = sum_leaving(as_paths(motion, blocks), consistent, motion, step)
    accepted = np.unpackbits(masks, axis=2, count=SIZE[1])[np.arange(step) // 8]
    np.testing.assert_array_equal(total.ones, (bits.to_array()[:step] * accepted).sum(axis=0))
    np.testing.assert_array_equal(total.trials, accepted.sum(axis=0))


def test_there_are_never_more_trials_than_bits(everything_agrees):
    old, own = sums_of(smooth_scene(), rng=1), sums_of(smooth_scene(), trials=4, rng=2)
    memory = remembered(old.masked(np.indices(SIZE)[1] >= 30), moved([(0, 0.5)]))
    (total,) = memory.recall([own], EVERY, moved([(0, 0.5)]), start=8)
    (kept,) = memory._sums
    assert kept.trials.max() <= FADING * 32 * (1 + 1e-5)
    np.testing.assert_allclose(total.trials[:, :28], 4)
    assert (kept.trials[:, 32:-2] > 28).all()


def test_bits_fade_with_the_frames_between_windows(everything_agrees):
    old, own = sums_of(smooth_scene(), rng=1), sums_of(smooth_scene(), rng=2)
    last, motion = moved([(0, 0)], reference=31.0), moved([(0, 0)], reference=16.0)
    (total,) = remembered(old, last).recall([own], EVERY, motion, start=8)
    expected = (own.ones + FADING * old.ones) / (32 + FADING * 32)
    np.testing.assert_allclose(total.ones / total.trials, expected, rtol=1e-4)


def test_the_means_of_the_jots_stay_in_the_range_of_the_maps(everything_agrees):
    maps = np.ones((3, *SIZE), np.float32)
    maps[:2] = np.where(np.arange(SIZE[1]) % 16 < 8, 0.0, 1.0)  # splines swing at these steps
    jots, motion = Jots(1, Jot(1.0, 0.0), maps), moved([(0, 0.5)])
    old, own = sums_of(smooth_scene(), rng=1), sums_of(smooth_scene(), trials=1, rng=2)
    for sums in (old, own):
        sums.jots = SeenJots(jots, 0 * maps[:2])
    old.jots = SeenJots(jots, maps[:2] * 32)
    memory = remembered(old, motion)
    memory.recall([own], EVERY, motion, start=8)
    (kept,) = memory._sums
    assert kept.jots.sums.min() >= 0
    assert (kept.jots.sums <= kept.trials).all()


def test_other_segments_end_the_memory():
    labels = np.zeros(SIZE, np.uint8)
    labels[:, :32] = 1
    memory = remembered(sums_of(smooth_scene(), rng=1), moved([(0, 0)] * 3, labels=labels))
    own = sums_of(smooth_scene(), rng=1)
    motion = moved([(0, 0)] * 2, labels=labels)
    assert memory.recall([own], EVERY, motion, start=8) == [own]


@pytest.mark.parametrize(
    ("memory", "causal", "upsample", "most"),
    [
        (None, True, 1, 31),
        (None, False, 1, 0),
        (None, True, 2, 0),
        (False, True, 1, 0),
    ],
)
def test_a_film_remembers_if_the_next_window_has_the_last_time(memory, causal, upsample, most):
    found = [
        step
        for step in range(1, 40)
        if remembers(memory, 32, step, causal=causal, upsample=upsample)
    ]
    assert found == list(range(1, most + 1))


@pytest.mark.parametrize(("causal", "most"), [(False, 16), (True, 31)])
def test_a_film_that_must_remember_needs_a_small_step(causal, most):
    assert remembers(True, 32, most, causal=causal, upsample=1)
    with pytest.raises(ValueError, match=rf"at most {most} .* got {most + 1}; pass step={most} "):
        remembers(True, 32, most + 1, causal=causal, upsample=1)
    with pytest.raises(ValueError, match=r"at most 0 for windows of 1, got 1; leave out memory=T"):
        remembers(True, 1, 1, causal=causal, upsample=1)
