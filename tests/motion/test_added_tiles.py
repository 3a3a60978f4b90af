"""Tiles that move by themselves, where segments do not explain a scene."""

import dataclasses

import numpy as np
import pytest

from jotlight.motion.added_tiles import add_tiles, degrees_of_freedom, is_unexplained
from jotlight.motion.consistency import find_consistent
from jotlight.motion.deformation import LESS_SMOOTH
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


def test_degrees_of_freedom_are_those_of_a_linear_estimate():
    """The estimate (A + λ)⁻¹ b depends on b through a matrix, whose trace with A is counted."""
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(3, 4, 5, 2, 2))
    matrices = roots @ roots.swapaxes(-1, -2)
    information = np.stack([matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]], axis=1)
    weight = 4 * LESS_SMOOTH.to_affine
    hats = matrices @ np.linalg.inv(matrices + weight * np.eye(2))
    expected = np.trace(hats, axis1=-2, axis2=-1).sum()
    assert degrees_of_freedom(information, LESS_SMOOTH) == pytest.approx(expected)


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
    assert more is paths or more.free == 1
