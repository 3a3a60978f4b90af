"""Another reference time: composition with the displacements, by brute force."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.reference_time import move_labels, move_nodes
from jotlight.motion.tiles import affine_basis, interpolate_at, tile_counts
from moving import constant_motion

SIZE = 80, 112
TIMES = np.array([0.0, 10, 20, 30])


def affine_nodes(rng, slope=0.04, shift=5.0):
    """Return affine displacements at the times, (4, 2, rows, columns)."""
    shape = tile_counts(SIZE)
    coefficients = rng.normal(size=(4, 2, 3)) * [shift, slope * SIZE[0], slope * SIZE[1]]
    return (coefficients @ affine_basis(shape).T).reshape(4, 2, *shape).astype(np.float32)


def motion_of(nodes, labels=None, reference=0.0):
    information = np.ones((len(nodes), 4, 3, *nodes.shape[3:]), np.float32)
    labels = np.zeros(SIZE, np.uint8) if labels is None else labels
    return jl.Motion(nodes, labels, TIMES, reference, "tiles", information)


def test_points_of_affine_motions_keep_their_paths():
    """A point that is at x at the new time and at y at the old one has one path through frames."""
    nodes = affine_nodes(np.random.default_rng(0))
    nodes -= nodes[:1]
    motion = motion_of(nodes[None])
    moved = motion.seen_from(20)
    assert moved.reference == 20
    np.testing.assert_allclose(moved.at(20), 0, atol=1e-4)
    for y in ((40.0, 50.0), (20.0, 90.0), (60.0, 30.0)):
        start = np.array(y, np.float32).reshape(2, 1)
        now = start + interpolate_at(motion.nodes_at(20)[0], start)
        for time in (0, 5, 30):
            path = start + interpolate_at(motion.nodes_at(time)[0], start)
            found = now + interpolate_at(moved.nodes_at(time)[0], now)
            np.testing.assert_allclose(found, path, atol=2e-3)


def test_there_and_back_is_the_same_motion():
    nodes = affine_nodes(np.random.default_rng(1))
    nodes -= nodes[:1]
    motion = motion_of(nodes[None])
    again = motion.seen_from(25).seen_from(0)
    np.testing.assert_allclose(again.nodes, motion.nodes, atol=2e-3)
    assert again.reference == 0


def test_smooth_deformations_come_back_approximately():
    rng = np.random.default_rng(2)
    smooth = affine_nodes(rng, shift=3) + rng.normal(0, 0.3, (4, 2, *tile_counts(SIZE)))
    nodes = smooth - smooth[:1]
    now = nodes[2].astype(np.float32)
    moved = move_nodes(nodes.astype(np.float32), now)
    back = move_nodes(moved, moved[0])
    # Nodes of the moved motion sample the field elsewhere, so peaks are lost.
    inner = (slice(None), slice(None), slice(1, -1), slice(1, -1))
    assert np.sqrt(((back - nodes)[inner] ** 2).mean()) < 0.3
    np.testing.assert_allclose(moved[2], 0, atol=1e-4)


def test_whole_shifts_are_only_subtracted():
    motion = constant_motion([(0, 0), (2, -4), (6, 3)], (40, 60), [0, 4, 8], 0)
    moved = motion.seen_from(4)
    for time, expected in ((0, (-2, 4)), (4, (0, 0)), (8, (4, 7)), (6, (2, 3.5))):
        np.testing.assert_allclose(moved.at(time)[:, 20, 30], expected, atol=1e-4)
    np.testing.assert_array_equal(moved.labels, motion.labels)


def test_labels_move_with_their_fields():
    """An object moves by 9 rows and -5 columns, and the background by 2 and 3."""
    labels = np.zeros(SIZE, np.uint8)
    labels[30:50, 40:70] = 1
    shifts = np.array([(2, 3), (9, -5)])
    now = np.zeros((2, 2, *tile_counts(SIZE)), np.float32) + shifts[:, :, None, None]
    moved = move_labels(labels, now)
    expected = np.zeros(SIZE, np.uint8)
    for row, column in np.ndindex(*SIZE):
        if labels[row, column] == 1:
            expected[row + 9, column - 5] = 1
    np.testing.assert_array_equal(moved, expected)


def test_a_pixel_that_nothing_moves_to_belongs_to_the_most_frequent_field():
    labels = np.zeros(SIZE, np.uint8)
    labels[:, 60:] = 1
    shifts = np.array([(0, -10), (0, 10)])
    now = np.zeros((2, 2, *tile_counts(SIZE)), np.float32) + shifts[:, :, None, None]
    moved = move_labels(labels, now)
    # The fields part by 20 columns. Between them, no point of the image was visible before.
    assert (moved[:, :50] == 0).all()
    assert (moved[:, 70:] == 1).all()
    assert (moved[:, 50:70] == 0).all()


@pytest.mark.parametrize("fields", [1, 3])
def test_labels_stay_where_nothing_moves(fields):
    labels = np.random.default_rng(3).integers(0, fields, SIZE, np.uint8)
    still = np.zeros((fields, 2, *tile_counts(SIZE)), np.float32)
    np.testing.assert_array_equal(move_labels(labels, still), labels)


def test_times_far_from_the_burst_have_a_limited_displacement():
    motion = constant_motion([(0, 0), (2, -4)], (40, 60), [0, 4], 0)
    assert motion.seen_from(1e4).reference == 1e4
    for time in (1e9, -1e300):
        assert abs(motion.at(time)).max() == 1e5
    for time in (-1e300, np.inf, np.nan):
        with pytest.raises(ValueError, match="expected"):
            motion.seen_from(time)


def test_motions_that_fold_the_image_have_finite_displacements():
    nodes = np.random.default_rng(4).normal(0, 1e4, (4, 2, *tile_counts(SIZE))).astype(np.float32)
    moved = move_nodes(nodes, nodes[1])
    assert np.isfinite(moved).all()
    labels = np.random.default_rng(5).integers(0, 2, SIZE, np.uint8)
    assert move_labels(labels, nodes[:2]).max() <= 1
