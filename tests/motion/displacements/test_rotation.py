"""Rotation and zoom: the sum of the scores of windows along an affine velocity."""

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.motion.displacements.rotation import find_rotation
from jotlight.motion.displacements.velocity import find_velocities
from moving import blocks_of


def grid(rows, columns, distance):
    places = np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1)
    places = places.reshape(-1, 2) * distance
    return places - places.mean(axis=0)


def peaks(centers, line, velocity, matrix):
    """Return the scores of windows: noise, and a peak at the velocity of each."""
    scores = np.random.default_rng(0).normal(0, 1, (len(centers), len(line), len(line)))
    squares = line[:, None], line[None]
    for each, center in zip(scores, centers, strict=True):
        row, column = velocity + matrix @ center
        step = line[1] - line[0]
        distance = ((squares[0] - row) ** 2 + (squares[1] - column) ** 2) / step**2
        each += 3 * np.exp(-distance / 2)
    return scores.astype(np.float32)


@pytest.mark.parametrize(("rotation", "zoom"), [(0.05, 0.0), (-0.08, 0.02), (0.01, -0.02)])
def test_a_rotation_is_found_that_no_window_shows_alone(rotation, zoom):
    centers, line = grid(4, 5, 64), np.arange(-21, 22) / 10
    matrix = np.array([[zoom, -rotation], [rotation, zoom]]) / 10
    velocity = np.array([0.3, -0.5])
    found, change = find_rotation(peaks(centers, line, velocity, matrix), centers, line, 2)
    np.testing.assert_allclose(found, velocity, atol=0.11)
    # The farthest window must be right within a step.
    assert abs((change - matrix) @ centers.T).max() < 0.15


def test_a_constant_velocity_is_no_rotation():
    centers, line = grid(4, 5, 64), np.arange(-21, 22) / 10
    scores = peaks(centers, line, np.array([0.3, -0.5]), np.zeros((2, 2)))
    assert find_rotation(scores, centers, line, 1) is None


def test_few_windows_show_no_rotation():
    line = np.arange(-5, 6) / 10
    scores = np.random.default_rng(0).normal(0, 1, (2, 11, 11)).astype(np.float32)
    assert find_rotation(scores, grid(1, 2, 64), line, None) is None
    assert find_rotation(scores[:1], grid(1, 1, 64), line, None) is None


def slow_peak(scores, shifts):
    """Return the largest sum of shifted scores, and its place."""
    _, height, width = scores.shape
    total = np.zeros((height, width), np.float32)
    for each, (down, right) in zip(scores, shifts.tolist(), strict=True):
        for row, column in np.ndindex(height, width):
            if 0 <= row + down < height and 0 <= column + right < width:
                total[row, column] += each[row + down, column + right]
    row, column = np.unravel_index(total.argmax(), total.shape)
    return total[row, column], (row, column)


def test_peaks_of_shifted_scores_are_those_of_a_loop():
    rng = np.random.default_rng(1)
    scores = rng.random((4, 7, 9)).astype(np.float32)
    shifts = np.array([[0, 0], [2, -3], [-1, 9], [-6, 6]]) * rng.integers(-1, 2, (20, 4, 2))
    expected = [slow_peak(scores, each) for each in shifts]
    assert engine.peak_of_shifted_scores(scores, shifts, 1) == expected
    assert engine.peak_of_shifted_scores(scores[:, ::-1, ::-1], -shifts, 3) == [
        slow_peak(scores[:, ::-1, ::-1], -each) for each in shifts
    ]


@pytest.mark.parametrize("distance", [7, 2**62, -(2**63)])
def test_scores_shifted_out_of_view_count_nothing(distance):
    scores = np.ones((2, 7, 7), np.float32)
    shifts = np.array([[[0, distance], [0, 0]]])
    assert engine.peak_of_shifted_scores(scores, shifts, None) == [(1.0, (0, 0))]


@pytest.mark.parametrize(
    ("scores", "shape", "message"),
    [
        (np.zeros((2, 0, 5)), (1, 2, 2), "scores"),
        (np.full((2, 5, 5), np.nan), (1, 2, 2), "scores: expected finite numbers"),
        (np.zeros((2, 5, 5)), (1, 3, 2), "shifts"),
        (np.zeros((2, 5, 5)), (1, 2, 3), "shifts"),
    ],
)
def test_wrong_shifts_are_refused(scores, shape, message):
    with pytest.raises(ValueError, match=message):
        engine.peak_of_shifted_scores(scores.astype(np.float32), np.zeros(shape, np.int64), 1)


@pytest.mark.slow
def test_a_dim_scene_that_rotates_has_a_rotation_among_its_velocities():
    """Nearest neighbors of a rotated texture are enough to find its rotation."""
    rng = np.random.default_rng(2)
    texture = rng.random((48, 48)).repeat(8, axis=0).repeat(8, axis=1)
    rate, frames = 0.002, 128
    places = np.indices((256, 256)) - 127.5
    bits = np.empty((frames, 256, 256), bool)
    for frame in range(frames):
        angle = rate * (frame - frames // 2)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        rows, columns = np.rint(np.tensordot(turn, places, axes=1) + 191.5).astype(int)
        bits[frame] = rng.random((256, 256)) < 0.1 * texture[rows, columns]
    found = find_velocities(blocks_of(jl.Bits.from_array(bits)))
    centers = 16 * np.indices((16, 16)) + 7.5 - 127.5
    true = rate * np.stack([-centers[1], centers[0]])
    distances = np.hypot(*np.moveaxis(found - true, 1, 0)).max(axis=(1, 2))
    assert distances.min() < 0.25 * np.hypot(*true).max()
    assert distances[0] > 0.9 * np.hypot(*true).max()
