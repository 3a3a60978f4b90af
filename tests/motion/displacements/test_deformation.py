"""Motions of tiles, for scenes that deform."""

import numpy as np
import pytest

from jotlight.motion.displacements.deformation import follow_tiles
from jotlight.motion.tiles import affine_basis, affine_inverse, tile_counts
from moving import blocks_of, record


def errors_of(track, scene):
    return np.concatenate(
        [
            (track.displacements(block) - scene.motion(time))[:, scene.visible(time)].ravel()
            for block, time in enumerate(track.blocks.centers)
        ]
    )


def affine_motion(scene, blocks):
    """Return the affine displacements of tiles that are nearest to the true ones."""
    rows, columns = tile_counts(blocks.size)
    tiles = [scene.motion(time)[:, 8::16, 8::16].reshape(2, -1) for time in blocks.centers]
    affine = np.stack(tiles) @ affine_inverse((rows, columns)).T @ affine_basis((rows, columns)).T
    return affine.reshape(-1, 2, rows, columns)


@pytest.mark.slow
@pytest.mark.parametrize("photons", [0.1, 0.5])
def test_tiles_follow_a_scene_that_deforms(photons):
    scene, bits = record("sheet", frames=64, shape=(128, 128), photons=photons)
    blocks = blocks_of(bits)
    start = affine_motion(scene, blocks)
    track = follow_tiles(blocks, start)
    assert (track.information[:, [0, 2]] >= 0).all()
    assert 20 < track.freedom < 2 * 64 * 16
    found = np.mean(errors_of(track, scene) ** 2)
    track.nodes = start
    assert found < 0.15 * np.mean(errors_of(track, scene) ** 2)


@pytest.mark.slow
def test_tiles_hardly_deviate_from_the_motion_of_a_camera():
    scene, bits = record("shake", frames=64, shape=(128, 128))
    blocks = blocks_of(bits)
    track = follow_tiles(blocks, affine_motion(scene, blocks))
    assert track.freedom < 150
    assert np.sqrt(np.mean(errors_of(track, scene) ** 2)) < 0.35
