"""Objects that the segments of a scene do not explain."""

import dataclasses

import numpy as np
import pytest

from jotlight.motion.displacements.track import Paths
from jotlight.motion.outlines import objects
from jotlight.motion.outlines.depth import ComparedBits
from jotlight.motion.outlines.likelihood_gain import likelihood_gain
from jotlight.motion.outlines.objects import add_objects
from moving import blocks_of, occluded, paths_of

SIZE = 96, 112
VELOCITIES = (0, 0), (0, 1), (-1, 0)


def disk(row, column, radius):
    rows, columns = np.indices(SIZE)
    return np.hypot(rows - row, columns - column) < radius


MASKS = np.ones(SIZE, bool), disk(30, 44, 12), disk(66, 80, 10)


def background_of(number, frames=32):
    """Return the paths of a background that stands still, with some objects in front of it."""
    bits, _ = occluded(VELOCITIES[:number], MASKS[:number], frames)
    blocks = blocks_of(bits, 16)
    return paths_of(blocks, np.zeros((16, 2)), frames // 2)


def test_residuals_are_those_of_whole_counts():
    paths = background_of(2)
    residuals, frames = objects._residuals(paths)
    assert residuals.shape == (16, SIZE[0] // 2, SIZE[1] // 2)
    assert frames == 2
    deviations = residuals / objects._SCALE / np.sqrt(4 * 2)
    empty = (slice(None), slice(36, 48), slice(0, 20))
    assert deviations[empty].std() == pytest.approx(1, abs=0.15)
    assert abs(deviations[empty].mean()) < 0.3


def test_nothing_remains_where_known_objects_are():
    paths = background_of(2)
    nodes = paths.tracks[0].nodes + np.outer(paths.blocks.centers - 16, (0, 1))[:, :, None, None]
    track = dataclasses.replace(paths.tracks[0], nodes=nodes)
    labels = MASKS[1].astype(np.uint8)
    residuals, _ = objects._residuals(Paths([paths.tracks[0], track], labels))
    center = round(paths.blocks.centers[3] - 16) + 44
    assert (residuals[3, 12:18, center // 2 - 3 : center // 2 + 3] == 0).all()
    assert (residuals[3, 30:40] != 0).mean() > 0.9


def test_velocities_of_residuals_contain_those_of_objects():
    paths = background_of(3)
    found = np.array([velocity[:, 0, 0] for velocity in objects._residual_velocities(paths)])
    for velocity in VELOCITIES[1:]:
        assert np.hypot(*(found - velocity).T).min() < 0.3


def test_a_background_alone_has_no_objects():
    paths = background_of(1)
    assert add_objects(paths) is paths


@pytest.mark.slow
def test_two_objects_are_found():
    paths = background_of(3)
    found = add_objects(paths)
    assert len(found.tracks) == 3
    for mask, velocity in zip(MASKS[1:], VELOCITIES[1:], strict=True):
        index = int(np.bincount(found.labels[mask]).argmax())
        assert index > 0
        assert ((found.labels == index) != mask).sum() < 0.2 * mask.sum()
        speed = found.tracks[index].velocity().mean(axis=(1, 2))
        np.testing.assert_allclose(speed, velocity, atol=0.1)


def test_similar_velocities_are_tried_once():
    one, other = np.zeros((2, 1, 1)), np.full((2, 1, 1), 0.05)
    far = np.full((2, 1, 1), 0.5)
    kept = objects._distinct([one, other, far], [], 64)
    assert len(kept) == 2
    assert kept[0] is one
    assert kept[1] is far
    (kept,) = objects._distinct([one, other, far], [other], 64)
    assert kept is far


def test_the_velocity_of_a_candidate_is_refined():
    paths = background_of(2)
    bits = ComparedBits.of(paths)
    wrong = np.array([0.1, 0.85])[:, None, None] * np.ones(paths.tracks[0].nodes.shape[1:])
    first, second = objects._candidates(paths, bits, wrong)
    assert first.velocity is wrong
    at_center = second.velocity[:, 30 // 16, 44 // 16]
    assert np.hypot(*(at_center - VELOCITIES[1])) < 0.6 * np.hypot(0.1, 0.15)
    assert second.net > first.net
    assert (second.pixels != MASKS[1]).mean() < 0.02
    (followed,) = objects._best_distinct([first, second], 32)
    assert followed is second
    far = np.full_like(wrong, -2.0)
    assert objects._candidates(paths, bits, far) == []


@pytest.mark.slow
@pytest.mark.parametrize("error", [0.15, 0.0])
def test_a_motion_is_improved_inside_outlines_if_the_bits_are_then_more_likely(monkeypatch, error):
    paths = background_of(2)
    times = paths.blocks.centers - paths.reference
    nodes = paths.tracks[0].nodes + np.outer(times, (error, 1))[:, :, None, None]
    track = dataclasses.replace(paths.tracks[0], nodes=nodes)
    start = Paths([paths.tracks[0], track], MASKS[1].astype(np.uint8))
    better = objects._inside_outlines(start)
    assert likelihood_gain(better) >= likelihood_gain(start)
    speed = better.tracks[1].velocity().mean(axis=(1, 2))
    np.testing.assert_allclose(speed, VELOCITIES[1], atol=0.05)
    monkeypatch.setattr(objects, "likelihood_gain", lambda found: float(found is start))
    assert objects._inside_outlines(start) is start


def test_few_blocks_have_no_velocities():
    bits, _ = occluded(VELOCITIES[:1], MASKS[:1], 2)
    assert objects._residual_velocities(paths_of(blocks_of(bits, 1), np.zeros((1, 2)), 1)) == []
