"""The search for paths: their models, and which model explains the bits best."""

import dataclasses
import types

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion import path_search
from jotlight.motion.agreement.consistency import find_consistent
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.burst import as_burst
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.segments import Segment
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.outlines.added_tiles import share_of_unknown
from jotlight.motion.outlines.objects import MAX_OBJECTS
from jotlight.motion.path_search import Found, find_paths
from moving import blocks_of, record, two_halves


def find(bits, model):
    progress = []
    found = find_paths(blocks_of(bits), model, progress.append)
    assert progress[0] == 0
    assert progress[-1] == 1
    assert progress == sorted(progress)
    return found.paths, found.model


@pytest.mark.parametrize("model", ["none", "affine"])
def test_a_requested_model_is_used(model):
    _, bits = record("shake", photons=0.3)
    paths, name = find(bits, model)
    assert name == model
    assert len(paths.tracks) == 1
    assert (paths.labels == 0).all()
    assert (paths.tracks[0].nodes == 0).all() == (model == "none")


@pytest.mark.slow
def test_two_segments_are_found():
    velocities = (0.4, 0.3), (-0.3, 0.5)
    paths, name = find(two_halves(velocities, 48), "segments")
    assert name == "segments"
    assert len(paths.tracks) == 2
    speeds = [np.diff(track.nodes[[0, -1]], axis=0).mean(axis=(2, 3))[0] for track in paths.tracks]
    span = paths.blocks.centers[-1] - paths.blocks.centers[0]
    for velocity, columns in zip(velocities, (slice(16, 80), slice(112, 176)), strict=True):
        label = np.bincount(paths.labels[:, columns].ravel()).argmax()
        np.testing.assert_allclose(speeds[label] / span, velocity, atol=0.05)


@pytest.mark.parametrize(
    ("gains", "chosen", "tried"),
    [
        ([(50.0, True), (90.0, True)], 0, 1),
        ([(50.0, False), (90.0, False)], 1, 2),
        ([(50.0, False), (20.0, False)], 0, 2),
        ([(-5.0, False), (20.0, False)], 1, 2),
        ([(-5.0, False), (-9.0, False)], None, 2),
    ],
)
def test_the_division_that_gains_most_is_chosen_unless_the_first_is_clear(
    monkeypatch, gains, chosen, tried
):
    _, bits = record("shake", 16, shape=(32, 32))
    blocks = blocks_of(bits)
    paths = [Paths([Track.still(blocks)], np.zeros(blocks.size, np.uint8)) for _ in gains]
    for number, each in enumerate(paths):
        each.tracks[0].nodes[:] = number
    explained = []

    def explain(blocks, segments, *others):
        explained.append(segments[0])
        return Found(paths[segments[0]], "affine", None)

    monkeypatch.setattr(path_search, "find_segments", lambda *_: [[0], [1]])
    monkeypatch.setattr(path_search, "_or_constant_velocity", lambda *others: others[2])
    monkeypatch.setattr(path_search, "_explain", explain)
    monkeypatch.setattr(path_search, "_gain_over_rest", lambda found: gains[explained[-1]])
    found = find_paths(blocks, "auto", lambda _: None)
    assert len(explained) == tried
    assert found.model == ("none" if chosen is None else "affine")
    assert chosen is None or (found.paths.tracks[0].nodes == chosen).all()


@pytest.mark.slow
def test_long_bursts_are_aligned_with_a_part_of_their_frames(monkeypatch):
    """Their sums are not kept. But all their frames are tested and merged."""
    steps = []
    _, bits = record("shake", 128, shape=(256, 256), photons=2)
    blocks = Blocks(as_burst(bits), np.arange(0, 129, 16))

    def consistent(paths):
        steps.append(("test", paths.blocks.step))
        return find_consistent(paths)

    def follow(blocks, *others):
        steps.append(("follow", blocks.step))
        return segments_of(blocks, *others)

    segments_of = path_search._follow
    monkeypatch.setattr(path_search, "keeps_sums", lambda *_, **__: False)
    monkeypatch.setattr(path_search, "find_consistent", consistent)
    monkeypatch.setattr(path_search, "_follow", follow)
    found = find_paths(blocks, "auto", lambda _: None)
    assert steps[0][0] == "follow"
    assert steps[0][1] > 1
    assert steps[1:] == [("test", 1)]
    assert found.paths.blocks.step == 1
    assert found.consistent.total.trials.max() > 64


@pytest.mark.slow
def test_noise_stands_still():
    rng = np.random.default_rng(0)
    for density in (0.01, 0.5):
        bits = jl.Bits.from_array(rng.random((32, 48, 48)) < density)
        assert find(bits, "auto")[1] == "none"


def unknown_along(paths):
    return share_of_unknown(find_consistent(paths))


def test_pixels_whose_bits_disagree_are_unknown_but_dead_ones_are_not():
    stripes = np.where(np.arange(48) // 8 % 2, 0.5, 0.05)[:, None]
    p = np.where(np.arange(48) < 32, stripes, 0.275) * np.ones((64, 1, 1))
    # In the right third, the stripes of the central frames differ from those of all others.
    p[:, :, 32:] = 0.55 - stripes
    p[28:36, :, 32:] = stripes
    labels, valid = np.zeros((48, 48), np.uint8), np.zeros((48, 48), bool)
    valid[:, :24] = True
    shares, shares_of_left = [], []
    for seed in (3, 2, 1):
        rng = np.random.default_rng(seed)
        blocks = blocks_of(jl.Bits.from_array(rng.random((64, 48, 48)) < p))
        shares.append(unknown_along(Paths([Track.still(blocks)], labels)))
        left = dataclasses.replace(blocks, valid=np.packbits(valid, axis=1))
        shares_of_left.append(unknown_along(Paths([Track.still(left)], labels)))
    assert 0.35 < np.mean(shares) < 0.45
    assert np.mean(shares_of_left) < 0.02
    nothing = dataclasses.replace(blocks, valid=np.zeros((48, 6), np.uint8))
    assert unknown_along(Paths([Track.still(nothing)], labels)) == 0


@pytest.mark.parametrize(
    ("found", "of_slow", "gain", "more", "expected"),
    [
        ("tiles", "segments", 88.0, 0.002, "segments"),
        ("affine", "segments", 98.0, 0.002, "segments"),
        ("affine", "segments", 96.0, 0.002, "affine"),
        ("tiles", "segments", 86.0, 0.002, "tiles"),
        ("tiles", "tiles", 98.0, 0.002, "tiles"),
        ("tiles", "segments", 86.0, 0.004, "segments"),
        ("tiles", "segments", 88.0, -0.004, "tiles"),
        ("tiles", "tiles", 98.0, 0.004, "tiles"),
    ],
)
def test_slow_segments_are_used_if_they_explain_the_scene_better(
    monkeypatch, found, of_slow, gain, more, expected
):
    """A further segment of 16 blocks must gain 96 nats more than the paths found, which gain 1.

    Tiles with 5 degrees of freedom need 10 nats themselves. Gains decide unless the fraction of
    bits that agree is more than 0.003 larger or smaller.
    """
    _, bits = record("shake", 16, shape=(32, 32))
    blocks = blocks_of(bits)
    still = Track.still(blocks)
    tracks = [still, dataclasses.replace(still, freedom=5.0)]
    free = int(found == "tiles")
    first = Paths(tracks[: 1 + free], np.zeros(blocks.size, np.uint8), free=free)
    first.labels[:] = free
    slow = Paths(tracks, np.zeros(blocks.size, np.uint8))

    def segments(*_, is_slow=False):
        return [[of_slow] * 2] if is_slow else [[found]]

    def explain(_, parts, *__):
        is_slow = len(parts) == 2
        agreeing = types.SimpleNamespace(
            accepted=np.full(blocks.size, 0.9 + is_slow * more), total=Sums.zeros(blocks.size)
        )
        return Found(slow if is_slow else first, parts[0], agreeing, is_explained=False)

    monkeypatch.setattr(path_search, "find_segments", segments)
    monkeypatch.setattr(path_search, "_explain", explain)
    monkeypatch.setattr(path_search, "_gain_over_rest", lambda _: (50.0, True))
    monkeypatch.setattr(
        path_search, "likelihood_gain", lambda paths: gain if paths is slow else 1.0
    )
    result = find_paths(blocks, "auto", lambda _: None)
    assert result.model == expected
    assert len(result.paths.tracks) == len((slow if expected == "segments" else first).tracks)


@pytest.mark.parametrize(
    ("shares", "are_used"),
    [((0.069, 0.049), True), ((0.071, 0.01), False), ((0.06, 0.051), False), ((0.06, 0.06), False)],
)
def test_objects_must_explain_much_of_a_scene_that_is_mostly_unknown(monkeypatch, shares, are_used):
    """At first, 10 % of the pixels are unknown, then these fractions."""
    before, *along = (types.SimpleNamespace(unknown=each) for each in (0.1, *shares))
    made, calls = iter(along), []

    def add(paths, most):
        calls.append(most)
        return types.SimpleNamespace(exact=lambda: None)

    monkeypatch.setattr(path_search, "add_objects", add)
    monkeypatch.setattr(path_search, "find_consistent", lambda _: next(made))
    monkeypatch.setattr(path_search, "share_of_unknown", lambda sums: sums.unknown)
    paths = object()
    more, sums = path_search._with_large_objects(paths, before)
    assert (more is not paths) == are_used
    assert sums is (along[-1] if are_used else before)
    assert sum(calls) <= MAX_OBJECTS


@pytest.mark.parametrize(
    ("unknown", "gain", "rest", "expected"),
    [
        (0.05, 1.0, 5.0, "segments"),
        (0.05, -1.0, 5.0, "affine"),
        (0.05, -1.0, -5.0, "none"),
        (0.03, -1.0, 5.0, "segments"),
    ],
)
def test_parts_must_predict_frames_in_the_middle_if_much_is_unknown(
    monkeypatch, unknown, gain, rest, expected
):
    _, bits = record("static", frames=16, shape=(32, 48))
    track = Track.still(blocks_of(bits))
    labels = np.zeros((32, 48), np.uint8)
    labels[8:16] = 1
    still = Found(Paths([track], np.zeros_like(labels)), "none", None)
    found = Found(Paths([track, track], labels), "segments", find_consistent(track))
    held = []

    def held_out(paths, _, frames):
        held.append(frames)
        return gain * len(paths.tracks)

    monkeypatch.setattr(path_search, "share_of_unknown", lambda _: unknown)
    monkeypatch.setattr(path_search, "_held_out", held_out)
    monkeypatch.setattr(path_search, "_gain_over_rest", lambda _: (rest, False))
    result = path_search._without_wrong_parts(found, still)
    assert result.model == expected
    assert len(result.paths.tracks) == (2 if expected == "segments" else 1)
    assert len(set(held)) == (0 if unknown < 0.04 else 1)  # both predict the same frames
    if expected == "affine":
        np.testing.assert_array_equal(
            result.consistent.total.ones, find_consistent(result.paths).total.ones
        )


def test_a_wrong_part_predicts_held_out_frames_worse():
    """A part of a still scene moves away from it, but the bits of the background do not."""
    _, bits = record("static", frames=64, shape=(64, 96))
    blocks = blocks_of(bits)
    back, wrong = Track.still(blocks), Track.still(blocks)
    wrong.nodes += np.arange(len(blocks.centers))[:, None, None, None] - len(blocks.centers) / 2
    labels = np.zeros(blocks.size, np.uint8)
    labels[16:48, 24:72] = 1
    held = range(28, 36)
    gains = [
        path_search._held_out(paths, find_consistent(paths), held)
        for paths in (Paths([back], np.zeros_like(labels)), Paths([back, wrong], labels))
    ]
    assert gains[0] > gains[1] + 10


def test_held_out_frames_are_predicted_by_the_bits_that_are_counted(monkeypatch):
    _, bits = record("static", frames=16, shape=(32, 48))
    paths = Paths([Track.still(blocks_of(bits))], np.zeros((32, 48), np.uint8))
    counted = types.SimpleNamespace(total=Sums.zeros((32, 48)))
    monkeypatch.setattr(path_search, "select_bits", lambda *_: counted)
    monkeypatch.setattr(path_search, "held_out_likelihood", lambda _, total, held: (total, held))
    found = path_search._held_out(paths, find_consistent(paths), range(4, 8))
    assert found == (counted.total, range(4, 8))


def test_the_velocities_of_all_segments_are_tried_once(monkeypatch):
    """In dim light, the first segments may turn in a way that does not occur."""
    _, bits = record("static", frames=16, shape=(32, 48))
    blocks = blocks_of(bits)
    still = Found(Paths([Track.still(blocks)], np.zeros((32, 48), np.uint8)), "none", None)
    gains = {2.0: -5.0, 4.0: 7.0, 6.0: 3.0}
    tried = []

    def follow(blocks, segment):
        tried.append(float(segment.velocity.flat[0]) * 16)
        return Track.still(blocks)

    def segment(pixels):
        velocity = np.full((2, 2, 3), pixels / 16)
        return Segment(velocity, np.ones((2, 3)), 0.0, 8)

    monkeypatch.setattr(path_search, "follow_together", follow)
    monkeypatch.setattr(path_search, "_gain_over_rest", lambda _: (gains[tried[-1]], False))
    divisions = [[segment(2.0)], [segment(2.1), segment(0.5), segment(4.0)], [segment(6.0)]]
    found = path_search._or_constant_velocity(blocks, divisions, still, 0.0)
    assert tried == [2.0, 4.0, 6.0]
    assert (found.model, found.consistent is None) == ("affine", False)
    assert path_search._or_constant_velocity(blocks, divisions, still, 10.0) is still


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "frames", "brightest"),
    [
        (1, 2048, 0.3),
        pytest.param(1, 8192, 0.2, marks=pytest.mark.exhaustive),
        pytest.param(2, 8192, 0.1, marks=pytest.mark.exhaustive),
    ],
)
def test_a_few_dim_stars_show_how_the_camera_drifts(seed, frames, brightest):
    """The blocks of the last two cases get lost if they are aligned one after the other."""
    rng, size, path = np.random.default_rng(seed), 128, np.array([20.0, 12.0])
    bits = rng.random((frames, size, size), np.float32) < 0.002
    places = rng.uniform(-20, size + 20, (40, 2))
    light = np.minimum(0.03 * brightest / rng.uniform(0.03, 1, 40), brightest)
    for place, photons in zip(places, light, strict=True):
        times = rng.integers(0, frames, rng.poisson(frames * photons))
        shifts = np.multiply.outer(times / frames - 0.5, path)
        jots = np.rint(place + shifts + 1.1 * rng.normal(size=shifts.shape)).astype(int)
        inside = ((jots >= 0) & (jots < size)).all(axis=1)
        bits[times[inside], *jots[inside].T] = True
    motion = jl.align(jl.Bits.from_array(bits))
    ends = motion.at(frames - 1) - motion.at(0)
    np.testing.assert_allclose(ends.mean(axis=(1, 2)), path, atol=1)
