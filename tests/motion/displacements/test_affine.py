"""Affine motions of segments: what they follow, and how well they are known."""

import numpy as np
import pytest

import jotlight as jl
from jotlight import _engine as engine
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.affine import (
    agreement,
    extrapolate,
    follow_segment,
    is_renewed,
    start_track,
    sums_of_groups,
    template_and_agreement,
    template_of,
)
from jotlight.motion.displacements.segments import Segment
from jotlight.motion.displacements.track import Track
from jotlight.motion.tiles import affine_basis, tile_counts
from moving import blocks_of, moved, record
from reference import motion as reference


def follow_scene(scene, bits):
    blocks = blocks_of(bits)
    shape = tile_counts(blocks.size)
    at = scene.reference
    velocity = (scene.motion(at + 2) - scene.motion(at - 2)) / 4
    nodes = velocity[:, 8::16, 8::16][:, : shape[0], : shape[1]].astype(float)
    return follow_segment(blocks, Segment(nodes, np.ones(shape), energy=1.0, half=1))


@pytest.mark.parametrize(("motion", "limit"), [("shake", 0.25), ("rotate", 0.35)])
def test_an_affine_motion_is_followed_from_its_velocity(motion, limit):
    scene, bits = record(motion, photons=0.3)
    track = follow_scene(scene, bits)
    assert track.known.all()
    errors = [
        track.displacements(block) - scene.motion(time)
        for block, time in enumerate(track.blocks.centers)
    ]
    assert np.sqrt(np.mean(np.square(errors))) < limit
    # All displacements are affine in space.
    basis = affine_basis(track.nodes.shape[2:])
    nodes = track.nodes.reshape(-1, len(basis)).T
    fit = basis @ np.linalg.lstsq(basis, nodes, rcond=None)[0]
    np.testing.assert_allclose(fit, nodes, atol=1e-6)


@pytest.mark.parametrize("share", [0.25, 0.9])
def test_fits_of_all_blocks_are_those_of_the_twin(share):
    """The second share leaves less than the smallest assumed share of other blocks."""
    rng, size, number = np.random.default_rng(0), (40, 50), 3
    sums = []
    for _ in range(number):
        each = Sums.zeros(size)
        each.trials[:] = rng.integers(0, 9, size)
        each.ones[:], each.frames = rng.binomial(each.trials, 0.4), 8
        each.remainders[:] = rng.uniform(-2, 2, each.remainders.shape)
        sums.append(each)
    trials = np.full(size, round(4 / share), np.int32)
    template = rng.uniform(0.1, 0.9, size).astype(np.float32), trials
    weights, basis = rng.uniform(0, 1, (3, 4)), affine_basis((3, 4))
    filtered = engine.FilteredTemplate(*template, 1.0, None)
    blocks = [(each.ones, each.trials, each.remainders, each.frames) for each in sums]
    arguments = filtered, (float(trials.mean()), 0.3), blocks, weights, basis
    errors, information = engine.fit_blocks(*arguments, 1)
    expected = reference.fit_blocks(sums, template, 1.0, weights, basis, 0.3)
    np.testing.assert_allclose(errors, expected[0], rtol=1e-3, atol=1e-4 * abs(errors).max())
    scale = abs(information).max()
    np.testing.assert_allclose(information, expected[1], rtol=1e-3, atol=1e-4 * scale)
    for threads in (2, 3):
        again = engine.fit_blocks(*arguments, threads)
        for one, other in zip((errors, information), again, strict=True):
            np.testing.assert_array_equal(one, other)
    mixed = [blocks[0], (*(each.astype(np.float32) for each in blocks[1][:2]), *blocks[1][2:])]
    with pytest.raises(TypeError, match="all int32 or all float32"):
        engine.fit_blocks(*arguments[:2], mixed, weights, basis, None)


@pytest.mark.slow
def test_an_object_seldom_draws_the_motion_away():
    # The object hides 39 % of the scene, so the result depends on their details.
    options = {"shape": (128, 128), "photons": 0.3}
    times = np.arange(64)
    path = 6 * np.stack([np.sin(0.1 * times), np.cos(0.07 * times)], axis=1)
    errors = []
    for seed in range(5):
        scene, bits = record("shake", 64, rng=seed, **options)
        _, object_bits = moved(path, rng=50 + seed, **options)
        frames = bits.to_array().copy()
        frames[:, 30:110, 30:110] = object_bits.to_array()[:, 30:110, 30:110]
        track = follow_scene(scene, jl.Bits.from_array(frames))
        deviations = [
            track.displacements(block) - scene.motion(time)
            for block, time in enumerate(track.blocks.centers)
        ]
        errors.append(np.sqrt(np.mean(np.square(deviations))))
    # Without the weights of tiles, it is 1.3.
    assert np.median(errors) < 0.2


def test_the_two_central_blocks_start_at_the_velocity():
    _, bits = record("shake")
    blocks = blocks_of(bits)
    velocity = np.random.default_rng(0).normal(size=(2, *tile_counts(blocks.size)))
    track = start_track(blocks, velocity)
    assert np.flatnonzero(track.known).tolist() == [7, 8]
    for block in (7, 8):
        expected = velocity * (blocks.centers[block] - 24)
        np.testing.assert_allclose(track.nodes[block], expected)


def test_displacements_are_extrapolated_with_the_last_velocity():
    _, bits = record("shake")
    blocks = blocks_of(bits)
    shape = tile_counts(blocks.size)
    velocity = np.random.default_rng(1).normal(size=(2, *shape))
    track = start_track(blocks, 0 * velocity)
    # All known blocks lie on a line, so its continuation is exact.
    for block in (6, 7, 8, 9):
        track.nodes[block] = velocity * blocks.centers[block] + 5
        track.known[block] = True
    for block in (5, 10):
        extrapolate(track, block, np.full((2, *shape), 100.0))
        np.testing.assert_allclose(track.nodes[block], velocity * blocks.centers[block] + 5)
    track.known[:] = False
    track.known[7] = True
    extrapolate(track, 8, velocity)
    change = track.nodes[8] - track.nodes[7]
    np.testing.assert_allclose(change, velocity * (blocks.centers[8] - blocks.centers[7]))


def test_the_template_is_renewed_when_it_has_doubled():
    assert [n for n in range(1, 70) if is_renewed(n)] == [1, 2, 4, 8, 16, 32, 48, 64]


def test_blocks_are_added_up_once_for_the_template_and_its_agreement(monkeypatch):
    _, bits = record("shake")
    track = Track.still(blocks_of(bits))
    track.known[-1] = False
    expected = template_of(track)
    weights, added = agreement(sums_of_groups(track), expected), []
    nearby_sums = Track.nearby_sums
    monkeypatch.setattr(
        Track, "nearby_sums", lambda self, block: added.append(block) or nearby_sums(self, block)
    )
    template, found = template_and_agreement(track)
    assert added == list(range(len(track.nodes) - 1))
    np.testing.assert_array_equal(template.probability, expected.probability)
    np.testing.assert_array_equal(found, weights)
