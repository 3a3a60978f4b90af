"""Tiles that move by themselves, where segments do not explain a scene."""

import dataclasses

import numpy as np
import pytest

from jotlight.motion.agreement.consistency import find_consistent
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.outlines import added_tiles
from jotlight.motion.outlines.added_tiles import (
    _with_track,
    add_tiles,
    is_unexplained,
    needed_by_tiles,
)
from jotlight.motion.path_search import find_paths
from moving import blocks_of, record


def along_affine_motion(motion, **options):
    scene, bits = record(motion, **options)
    paths = find_paths(blocks_of(bits), "affine", lambda _: None).paths
    return scene, paths, find_consistent(paths)


def squared_error(paths, scene):
    """Return the mean squared error of the displacements, in pixels."""
    errors = [
        (paths.displacements(block) - scene.motion(time))[:, scene.visible(time)] ** 2
        for block, time in enumerate(paths.blocks.centers)
    ]
    return np.concatenate([each.ravel() for each in errors]).mean()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "frames", "size"),
    [
        (0, 48, 96),
        (0, 64, 128),
        *(pytest.param(seed, 64, 128, marks=pytest.mark.exhaustive) for seed in (1, 2)),
    ],
)
def test_tiles_are_added_to_a_scene_that_deforms(seed, frames, size):
    scene, paths, consistent = along_affine_motion(
        "sheet", frames=frames, shape=(size, size), rng=seed
    )
    assert is_unexplained(paths, consistent)
    more, sums = add_tiles(paths, consistent)
    assert more.free == 1
    assert len(more.tracks) == len(paths.tracks) + 1
    # An affine motion leaves the waves, which change their sign with time.
    assert squared_error(more, scene) < 0.5 * squared_error(paths, scene)
    assert sums.accepted.mean() > consistent.accepted.mean()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion", "frames", "size", "photons"),
    [
        ("shake", 48, 96, 0.5),
        ("shake", 64, 96, 0.1),
        ("shake", 32, 96, 1.0),
        ("static", 64, 32, 0.5),
        ("rotate", 128, 128, 0.2),
        ("static", 64, 128, 0.2),
    ],
)
def test_tiles_that_fit_noise_are_left_out(motion, frames, size, photons):
    _, paths, consistent = along_affine_motion(
        motion, frames=frames, shape=(size, size), photons=photons
    )
    same, sums = add_tiles(paths, consistent)
    assert same is paths
    assert sums is consistent


@pytest.mark.slow
def test_the_motion_of_a_camera_is_explained():
    _, paths, consistent = along_affine_motion("shake", frames=64, shape=(128, 128))
    assert not is_unexplained(paths, consistent)


@pytest.mark.parametrize(("share", "expected"), [(0.05, [1.0]), (0.25, [1.0, 0.25]), (1.0, [1.0])])
def test_tiles_are_followed_everywhere_or_in_large_regions(monkeypatch, share, expected):
    _, bits = record("shake", 16, shape=(32, 80))
    blocks = blocks_of(bits)
    labels = np.zeros(blocks.size, np.uint8)
    monkeypatch.setattr(
        added_tiles, "choose_labels", lambda _: (np.arange(80) < 80 * share) | (labels > 0)
    )
    candidates = _with_track(Paths([Track.still(blocks)], labels), Track.still(blocks))
    assert [float((each.labels == 1).mean()) for each in candidates] == expected
    assert all(each.free == 1 for each in candidates)


@pytest.mark.slow
def test_parts_of_a_deformation_are_no_segments():
    """Tiles also deviate from the largest track, which explains a sheet better than two parts."""
    scene, paths, _ = along_affine_motion("sheet", frames=64, shape=(128, 128))
    track = paths.tracks[0]
    wrong = dataclasses.replace(track, nodes=0.5 * track.nodes)
    labels = np.zeros_like(paths.labels)
    labels[:, 80:] = 1
    two = Paths([track, wrong], labels)
    more, _ = add_tiles(two, find_consistent(two))
    assert squared_error(more, scene) < 0.5 * squared_error(paths, scene)


@pytest.mark.slow
def test_paths_along_which_more_bits_agree_are_kept():
    _, paths, consistent = along_affine_motion("sheet", frames=48, shape=(96, 96))
    every = dataclasses.replace(consistent, accepted=np.ones_like(consistent.accepted))
    same, sums = add_tiles(paths, every)
    assert same is paths
    assert sums is every


@pytest.mark.slow
def test_the_model_of_tiles_needs_no_test():
    _, paths, _ = along_affine_motion("shake", frames=32, shape=(64, 64), rng=0)
    more, sums = add_tiles(paths, None)
    assert sums is None
    assert more.free == 1


def test_tiles_need_nats_for_their_degrees_of_freedom_where_pixels_follow_them():
    _, bits = record("shake", 16, shape=(32, 32))
    still = Track.still(blocks_of(bits))
    tracks = [still, dataclasses.replace(still, freedom=30.0)]
    labels = np.zeros((32, 32), np.uint8)
    labels[:8] = 1
    assert needed_by_tiles(Paths(tracks, labels, free=1)) == 2 * 30 / 4
    assert needed_by_tiles(Paths(tracks, labels)) == 0


@pytest.mark.parametrize("photons", [0.1, 0.5])
def test_displaced_frames_of_dim_scenes_are_not_explained(monkeypatch, photons):
    _, paths, consistent = along_affine_motion("shake", frames=64, photons=photons)
    assert not is_unexplained(paths, consistent)
    monkeypatch.setattr(added_tiles, "is_displaced", lambda *_: True)
    # In bright light, pixels show it.
    assert is_unexplained(paths, consistent) == (photons == 0.1)
    two = dataclasses.replace(paths, tracks=paths.tracks * 2)
    assert not is_unexplained(two, consistent)
