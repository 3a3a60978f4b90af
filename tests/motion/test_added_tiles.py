"""Tiles that move by themselves, where segments do not explain a scene."""

import dataclasses

import numpy as np
import pytest

from jotlight.motion.added_tiles import add_tiles, is_unexplained
from jotlight.motion.consistency import find_consistent
from jotlight.motion.model import find_paths
from moving import blocks_of, record


def along_affine_motion(motion, **options):
    scene, bits = record(motion, **options)
    blocks = blocks_of(bits)
    paths = find_paths(blocks, scene.reference, "affine", lambda _: None).paths
    return scene, blocks, paths, find_consistent(paths)


def squared_error(paths, scene):
    """Return the mean squared error of the displacements, in pixels."""
    errors = [
        (paths.displacements(block) - scene.motion(time))[:, scene.visible(time)] ** 2
        for block, time in enumerate(paths.blocks.centers)
    ]
    return np.concatenate([each.ravel() for each in errors]).mean()


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))]
)
def test_tiles_are_added_to_a_scene_that_deforms(seed):
    scene, blocks, paths, consistent = along_affine_motion(
        "sheet", frames=64, shape=(128, 128), rng=seed
    )
    assert is_unexplained(paths, consistent)
    more, sums = add_tiles(blocks, scene.reference, paths, consistent)
    assert more.free == 1
    assert len(more.tracks) == len(paths.tracks) + 1
    # An affine motion leaves the waves, which change their sign with time.
    assert squared_error(more, scene) < 0.5 * squared_error(paths, scene)
    assert sums.accepted.mean() > consistent.accepted.mean()


@pytest.mark.parametrize("photons", [0.05, 0.5])
def test_the_motion_of_a_camera_is_explained(photons):
    _, _, paths, consistent = along_affine_motion(
        "shake", frames=64, shape=(128, 128), photons=photons
    )
    assert not is_unexplained(paths, consistent)


def test_paths_along_which_more_bits_agree_are_kept():
    scene, blocks, paths, consistent = along_affine_motion("sheet", frames=48, shape=(96, 96))
    every = dataclasses.replace(consistent, accepted=np.ones_like(consistent.accepted))
    same, sums = add_tiles(blocks, scene.reference, paths, every)
    assert same is paths
    assert sums is every


def test_the_model_of_tiles_needs_no_test():
    scene, blocks, paths, _ = along_affine_motion("shake", frames=32, shape=(64, 64), rng=0)
    more, sums = add_tiles(blocks, scene.reference, paths, None)
    assert sums is None
    assert more is paths or more.free == 1
