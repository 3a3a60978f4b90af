"""The bits from before the window of a film's image."""

import dataclasses
import itertools

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion import consistency
from jotlight.motion import film as films
from jotlight.motion import memory as memory_module
from jotlight.motion.blocks import Sums
from jotlight.motion.film import LiveFilm, film
from jotlight.motion.jots import Jots, SeenJots
from jotlight.motion.memory import Memory, sum_first
from jotlight.motion.motion import Motion
from jotlight.motion.tiles import tile_counts
from jotlight.motion.track import Paths, Track
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
    return Motion(nodes, labels, times, reference, "segments", information)


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
    (total,) = remembered(old, motion).recall([own], EVERY, motion, start=8, is_carried=True)
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
    memory.recall([own], EVERY, motion, start=8, is_carried=True)
    memory.remember([Sums.zeros(SIZE)], motion, start=8)
    (again,) = memory.recall([own], EVERY, motion, start=16, is_carried=True)
    expected = (own.ones + FADING**2 * old.ones) / (32 + FADING**2 * 32)
    np.testing.assert_allclose(again.ones / again.trials, expected, rtol=1e-4)


def test_pixels_that_disagree_and_their_neighbors_are_not_counted(monkeypatch):
    monkeypatch.setattr(memory_module, "_MAX_DISAGREEMENT", 2.0)
    motion = moved([(0, 0)])
    scene = 0.5 * smooth_scene() + 0.25
    changed = scene.copy()
    changed[:, 40:] += np.where(np.arange(40, SIZE[1]) // 8 % 2, 0.12, -0.12)
    memory = remembered(sums_of(scene, rng=1), motion)
    (total,) = memory.recall([sums_of(changed, rng=2)], EVERY, motion, start=8, is_carried=True)
    assert (total.trials[:, 36:] == 32).all()
    assert (total.trials[:, :16] > 32).mean() > 0.8


def test_pixels_that_are_not_trusted_are_not_counted(monkeypatch):
    monkeypatch.setattr(memory_module, "_MAX_DISAGREEMENT", np.inf)
    motion, scene = moved([(0, 0)]), smooth_scene()
    trusted = np.ones(SIZE, bool)
    trusted[20, 30] = False
    memory = remembered(sums_of(scene, rng=1), motion)
    (total,) = memory.recall([sums_of(scene, rng=2)], trusted, motion, start=8, is_carried=True)
    y, x = np.indices(SIZE)
    near = abs(y - 20) + abs(x - 30) <= 5
    assert (total.trials[near] == 32).all()
    far = abs(y - 20) + abs(x - 30) > 6
    assert (total.trials[far] > 32).all()


def test_points_that_another_segment_hid_are_not_counted():
    labels = np.zeros(SIZE, np.uint8)
    labels[:, :32] = 1
    motion = moved([(0, 0), (0, 4)], labels=labels)
    before = np.zeros(SIZE, np.uint8)
    before[:, :40] = 1  # 8 columns further to the right
    memory = remembered(sums_of(smooth_scene(), rng=1), moved([(0, 0), (0, 0)], labels=before))
    own = sums_of(smooth_scene(), rng=1)
    (total,) = memory.recall([own], EVERY, motion, start=8, is_carried=True)
    assert (total.trials[:, 32:40] == 32).all()
    fresh = remembered(sums_of(smooth_scene(), rng=1), motion)
    assert fresh.recall([own], EVERY, motion, start=8, is_carried=False) == [own]


def test_nothing_is_recalled_from_before_the_window_or_after_the_motion_is_lost():
    motion, own = moved([(0, 0)]), sums_of(smooth_scene())
    memory = remembered(own, motion)
    assert memory.recall([own], EVERY, motion, start=17, is_carried=True) == [own]
    memory = remembered(own, motion)
    memory.forget()
    assert memory.recall([own], EVERY, motion, start=8, is_carried=True) == [own]


def test_what_the_bits_have_seen_of_the_jots_is_displaced():
    maps = np.ones((3, *SIZE), np.float32)
    maps[0] = 0.5 + np.arange(SIZE[1]) / 200
    jots = Jots(1, (1.0, 0.0), maps)
    old, own = sums_of(smooth_scene(), rng=1), sums_of(smooth_scene((0, 2)), rng=1)
    for sums in (old, own):
        sums.jots = SeenJots(jots, maps[:2] * sums.trials)
    motion = moved([(0, 2)])
    (total,) = remembered(old, motion).recall([own], EVERY, motion, start=8, is_carried=True)
    counted = total.trials[:, :-2] > 32
    assert counted.mean() > 0.5
    expected = (maps[0, :, :-2] + FADING * maps[0, :, 2:]) / (1 + FADING)
    found = total.jots.sums[0] / total.trials
    np.testing.assert_allclose(found[:, :-2][counted], expected[counted], rtol=1e-3)


@pytest.mark.parametrize("step", [5, 8, 12])
def test_the_first_frames_are_counted_once(step):
    rng = np.random.default_rng(4)
    bits = jl.Bits.from_array(rng.random((32, *SIZE)) < 0.3)
    edges = np.arange(0, 33, 8)
    masks = np.packbits(rng.random((4, *SIZE)) < 0.7, axis=2)
    blocks = dataclasses.replace(blocks_of(bits), edges=np.union1d(edges, step))
    number = len(blocks.centers)
    track = Track(
        blocks,
        16,
        np.zeros((number, 2, *tile_counts(SIZE))),
        np.ones(number, bool),
        np.ones((number, 3, *tile_counts(SIZE))),
    )
    total = sum_first(Paths([track], np.zeros(SIZE, np.uint8)), step, masks, edges)
    accepted = np.unpackbits(masks, axis=2, count=SIZE[1])[np.arange(step) // 8]
    np.testing.assert_array_equal(total.ones, (bits.to_array()[:step] * accepted).sum(axis=0))
    np.testing.assert_array_equal(total.trials, accepted.sum(axis=0))


def recorded(motion, frames, photons=0.5, **options):
    scene = jl.datasets.moving(
        jl.datasets.photograph("camera"),
        motion,
        sensor=jl.Sensor(frames=frames, **options),
        shape=(96, 96),
        photons=photons,
        rng=1,
    )
    return scene, jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.bits.sensor)


def test_the_counts_of_a_still_scene_are_those_of_all_frames_with_fading(monkeypatch):
    # All bits agree, in the windows and in the memory.
    monkeypatch.setattr(memory_module, "_MAX_IF_STILL", np.inf)
    monkeypatch.setattr(consistency, "_LIMITS_IF_STILL", (np.inf, np.inf))
    _, bits = recorded("static", 96)
    frames = bits.to_array()
    expected = np.zeros((2, 96, 96))
    for number, image in enumerate(film(bits, window=32, step=8, causal=True, model="none")):
        start = 8 * number
        window = np.stack([frames[start : start + 32].sum(axis=0), np.full((96, 96), 32)])
        ones, trials = window + expected
        assert np.abs(image.merged.ones - ones).max() <= 0.51
        known = image.merged.ones > 0
        found = image.merged.ones / image.merged.trials
        np.testing.assert_allclose(found[known], (ones / trials)[known], rtol=1e-4)
        leaving = np.stack([frames[start : start + 8].sum(axis=0), np.full((96, 96), 8)])
        expected = FADING * (expected + leaving)


def test_a_rejected_image_is_not_remembered_twice(monkeypatch):
    _, bits = recorded("static", 80)
    expected = [image.merged for image in film(bits, window=32, step=8, causal=True)]
    shares = itertools.cycle([1.0, 0.5])  # every second image is lost, and aligned afresh
    monkeypatch.setattr(films, "_accepted", lambda _: next(shares))
    found = list(film(bits, window=32, step=8, causal=True))
    assert not any(image.is_carried for image in found[1:])
    for image, other in zip(found, expected, strict=True):
        assert np.abs(image.merged.trials - other.trials).mean() < 3


def test_memory_improves_the_images_of_a_shaking_camera():
    scene, bits = recorded("shake", 160)
    inner = (slice(12, -12),) * 2

    def quality(memory):
        images = list(film(bits, window=64, step=16, causal=True, memory=memory))
        truth = scene.image(16 * (len(images) - 1) + 63)[inner]
        found = jl.pretrained(bits.sensor).reconstruct(images[-1].merged)[inner]
        return jl.metrics.psnr(found, truth, data_range=1.0)

    assert quality(True) > quality(False) + 0.4


def test_live_films_have_the_same_memory():
    _, bits = recorded("shake", 72)
    live = LiveFilm(bits.sensor, window=32, step=8)
    images = [image for start in range(0, 72, 8) for image in live.add(bits[start : start + 8])]
    others = list(film(bits, window=32, step=8, causal=True))
    assert max(image.merged.trials.max() for image in others) > 33
    for image, other in zip(images, others, strict=True):
        np.testing.assert_array_equal(image.merged.ones, other.merged.ones)
        np.testing.assert_array_equal(image.merged.trials, other.merged.trials)


def test_color_channels_are_remembered_side_by_side():
    photograph = jl.datasets.photograph("astronaut")[::4, ::4]
    scene = jl.datasets.moving(
        photograph, "static", sensor=jl.Sensor(frames=48), shape=(64, 64), photons=0.5, rng=1
    )
    images = list(film(scene.bits, window=32, step=8, causal=True))
    trials = images[-1].merged.trials
    assert trials.shape == (64, 64, 3)
    assert np.median(trials) > 40
    expected = 1 - np.exp(-scene.sensor.light_per_intensity * scene.image())
    found = images[-1].merged.ones.sum((0, 1)) / trials.sum((0, 1))
    np.testing.assert_allclose(found, expected.mean((0, 1)), atol=0.02)


def test_only_causal_films_remember_by_default_and_none_on_a_finer_grid():
    _, bits = recorded("static", 48)
    later = list(film(bits, window=32, step=8))
    assert max(image.merged.trials.max() for image in later) <= 32
    fine = list(film(bits, window=32, step=16, causal=True, upsample=2))
    assert fine[-1].merged.upsample == 2
    with pytest.raises(ValueError, match="memory: expected False with upsample=2, got True"):
        film(bits, window=32, step=8, memory=True, upsample=2)


def quality(image, scene):
    found = jl.pretrained(image.merged.sensor).reconstruct(image.merged)
    truth = scene.image(image.motion.reference + 64)
    inner = (slice(12, -12),) * 2
    return jl.metrics.psnr(found[inner], truth[inner], data_range=1.0)


def jots(kind):
    rng = np.random.default_rng(0)
    hot = np.where(rng.random((96, 96)) < 0.01, 2.0, 0.001)
    return {
        "efficiency": {"efficiency": np.linspace(0.6, 1, 96 * 96).reshape(96, 96)},
        "hot": {"dark_counts": hot},
        "dark": {"dark_counts": rng.gamma(2, 0.02, (96, 96))},
        "dead": {"mask": rng.random((96, 96)) < 0.01},
    }[kind]


@pytest.mark.filterwarnings("ignore:.*no valid bit")
@pytest.mark.parametrize(
    ("kind", "motion"),
    [
        ("efficiency", "static"),
        ("hot", "static"),
        ("dead", "shake"),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("efficiency", "shake"),
                ("hot", "shake"),
                ("dark", "static"),
                ("dark", "shake"),
                ("dead", "static"),
            )
        ),
    ],
)
def test_sensors_whose_jots_differ_are_remembered(kind, motion):
    scene, bits = recorded(motion, 96, **jots(kind))
    spans = {"window": 32, "step": 8, "causal": True}
    last = list(film(bits, **spans))[-1]
    without = list(film(bits, **spans, memory=False))[-1]
    assert np.median(last.merged.trials) > 40
    assert quality(last, scene) > quality(without, scene) - 0.05


def test_windows_that_do_not_overlap_remember_nothing():
    _, bits = recorded("static", 64)
    for step in (16, 20):
        images = list(film(bits, window=16, step=step, causal=True))
        assert max(image.merged.trials.max() for image in images) <= 16


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_change_of_brightness_ends_the_memory(factor):
    scene, bright = recorded("static", 64)
    sensor = bright.sensor.replace(gain=factor * bright.sensor.gain)
    other = sensor.expose(scene.image(), rng=3, threads=1)
    packed = np.concatenate([np.asarray(bright.packed), np.asarray(other.packed)])
    bits = jl.Bits(packed, 96, sensor.replace(frames=128))
    images = list(film(bits, window=32, step=8, causal=True))
    assert np.median(images[4].merged.trials) > 40  # frames 32 to 63
    rate = [image.merged.ones.sum() / image.merged.trials.sum() for image in images]
    after = np.unpackbits(np.asarray(other.packed), axis=2, count=96).mean()
    assert abs(rate[8] / after - 1) < 0.01  # frames 64 to 95


def test_there_are_never_more_trials_than_bits():
    motion, old = moved([(0, 0.5)]), sums_of(smooth_scene(), rng=1)
    old = old.masked(np.indices(SIZE)[1] >= 30)
    memory = remembered(old, motion)
    own = Sums.zeros(SIZE)  # agrees with everything
    (total,) = memory.recall([own], EVERY, motion, start=8, is_carried=True)
    assert total.trials.max() <= np.ceil(FADING * 32)
    assert (total.trials[:, :28] == 0).all()


def test_other_segments_end_the_memory():
    labels = np.zeros(SIZE, np.uint8)
    labels[:, :32] = 1
    memory = remembered(sums_of(smooth_scene(), rng=1), moved([(0, 0)] * 3, labels=labels))
    own = sums_of(smooth_scene(), rng=1)
    motion = moved([(0, 0)] * 2, labels=labels)
    assert memory.recall([own], EVERY, motion, start=8, is_carried=True) == [own]


def test_counts_and_pixels_of_several_jots_are_remembered():
    _, bits = recorded("static", 64, oversampling=2)
    last = list(film(bits, window=32, step=8, causal=True))[-1]
    assert last.merged.shape == (96, 96)
    assert 150 < np.median(last.merged.trials) < 3.5 * 128
