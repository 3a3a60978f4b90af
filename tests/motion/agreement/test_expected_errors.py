"""Expected errors: displacements that many tiles show together, and steep pixels."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter

from jotlight.motion.agreement.consistency import Consistent
from jotlight.motion.agreement.expected_errors import (
    is_displaced,
    may_hide_displacements,
    steep_pixels,
)
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.scoring import Template, make_template

SIZE = 160, 160


def scene_of(distance, rng, trials=16):
    """Return sums whose outermost frames are displaced by up to a distance, and their template."""
    texture = gaussian_filter(rng.normal(size=(SIZE[0] + 40, SIZE[1] + 40)), 3)
    texture = np.clip(0.2 + 0.1 * texture / texture.std(), 0.02, 0.9)
    rows, columns = np.indices(SIZE) + 20
    wave = np.rint(distance * np.sin(2 * np.pi * rows / SIZE[0])).astype(int)
    parts = []
    for displacement, frames in ((wave, trials), (0 * wave, 2 * trials), (-wave, trials)):
        sums = Sums.zeros(SIZE)
        sums.trials[:], sums.frames = frames, frames
        sums.ones[:] = rng.binomial(frames, texture[rows, columns + displacement])
        parts.append(sums)
    before, middle, after = parts
    accepted, masks = np.ones(SIZE, np.float32), np.zeros((0, *SIZE), np.uint8)
    consistent = Consistent(
        before + middle, after + Sums.zeros(SIZE), accepted, masks, outermost=(before, after)
    )
    return consistent, make_template(consistent.total, None)


@pytest.mark.slow
def test_displacements_are_noticed_and_noise_is_not():
    rng = np.random.default_rng(0)
    for distance in (0, 2):
        found = [is_displaced(*scene_of(distance, rng)) for _ in range(10)]
        assert found == [distance > 0] * 10


def test_a_side_without_frames_shows_nothing():
    consistent, template = scene_of(2, np.random.default_rng(1))
    sides = consistent.outermost[0], Sums.zeros(SIZE)
    assert is_displaced(dataclasses.replace(consistent, outermost=sides), template)


def test_only_dim_scenes_hide_displacements():
    dim, _ = scene_of(0, np.random.default_rng(2), trials=8)
    assert may_hide_displacements(dim)
    assert not may_hide_displacements(dataclasses.replace(dim, outermost=()))
    longer = tuple(dataclasses.replace(each, frames=30) for each in dim.outermost)
    assert not may_hide_displacements(dataclasses.replace(dim, outermost=longer))
    bright, _ = scene_of(0, np.random.default_rng(2), trials=16)
    assert not may_hide_displacements(bright)


def test_steep_pixels_are_near_the_edge():
    step = np.where(np.indices(SIZE)[1] < 80, 0.2, 0.4).astype(np.float32)
    found = steep_pixels(Template(step, np.ones(SIZE, np.int32)))
    edge = np.square(np.gradient(step)).sum(axis=0) > 0
    np.testing.assert_array_equal(found, maximum_filter(edge, 7))


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_steep_pixels_contain_nearly_all_squared_slopes(noise):
    rng = np.random.default_rng(3)
    image = gaussian_filter(rng.normal(size=SIZE), 4) + noise * rng.normal(size=SIZE)
    image = (0.3 + 0.1 * image / image.std()).astype(np.float32)
    found = steep_pixels(Template(image, np.ones(SIZE, np.int32)))
    slopes = np.square(np.gradient(image)).sum(axis=0)
    assert slopes[found].sum() > 0.95 * slopes.sum()
    assert not found.all()
    assert not steep_pixels(Template(np.full(SIZE, 0.3, np.float32), found.astype(np.int32))).any()
