"""Scores of velocities, with a slow correlation."""

import itertools

import numpy as np
import pytest

import jotlight._engine as engine
from jotlight.motion.displacements.velocity_scores import (
    BAND,
    BIN,
    WINDOW,
    VelocityScores,
    window_starts,
)
from reference import motion as reference

LAGS = (1, 2, 3, 4, 6, 8, 12, 16)


def scores_of(blocks, **arguments):
    """Return the scores of windows, by default of the whole image."""
    rest = {
        "corners": [(0, 0)], "size": blocks.shape[1:], "filters": BAND, "lags": [1, 2],
        "line": np.arange(-8, 9) / 2, "threads": 1,
    }  # fmt: skip
    return engine.velocity_scores(blocks, *(rest | arguments).values())


def test_scores_are_largest_at_the_displacement_of_periodic_images():
    """The images repeat a random texture, so a slow search of the best shift is exact."""
    rng = np.random.default_rng(1)
    texture = rng.integers(0, 100, (64, 64), np.int32)
    images = np.stack([np.roll(texture, (2 * n, -3 * n), (0, 1)) for n in range(6)])
    line = np.arange(-8, 9) / 2
    (scores,) = scores_of(images, line=line)
    row, column = np.unravel_index(scores.argmax(), scores.shape)
    best = max(
        ((y, x) for y in range(-4, 5) for x in range(-4, 5)),
        key=lambda shift: sum(
            (np.roll(one, shift, (0, 1)) * other).sum() for one, other in itertools.pairwise(images)
        ),
    )
    assert best == (2, -3)
    assert (line[row], line[column]) == best


@pytest.mark.parametrize("level", engine.cpu_levels())
@pytest.mark.parametrize(
    ("shape", "size", "number"),
    [
        ((70, 100), (48, 48), 20),
        ((41, 67), (41, 67), 20),
        ((31, 7), (13, 7), 4),
        ((9, 9), (1, 2), 3),
    ],
)
def test_scores_are_those_of_the_twin(level, shape, size, number):
    """Some windows have lengths with large prime factors, and places wrap around."""
    rng = np.random.default_rng(3)
    blocks = rng.poisson(3 * rng.random(shape), (number, *shape)).astype(np.int32)
    corners = [(0, 0), (shape[0] - size[0], shape[1] - size[1]), (3, 0)]
    corners = [(y, x) for y, x in corners if y + size[0] <= shape[0]]
    lags = [lag for lag in LAGS if lag < number]
    line = np.linspace(-0.45, 0.47, 17) * max(2, *size) / lags[-1]
    window = {"corners": corners, "size": size, "lags": lags, "line": line}
    engine.choose_cpu_level(level)
    try:
        scores, *others = (scores_of(blocks, **window, threads=threads) for threads in (1, 2, 3))
    finally:
        engine.choose_cpu_level(None)
    expected = reference.velocity_scores(blocks, corners, size, BAND, lags, line)
    np.testing.assert_allclose(scores, expected, atol=2e-3)
    for other in others:
        np.testing.assert_array_equal(other, scores)


@pytest.mark.parametrize("factor", [1, 10**6])
def test_scores_do_not_depend_on_the_unit_of_the_counts(factor):
    blocks = np.random.default_rng(4).integers(0, 2000, (8, 48, 48), np.int32)
    np.testing.assert_allclose(scores_of(factor * blocks), scores_of(blocks), atol=1e-4)


def test_equal_counts_have_the_score_zero():
    assert not scores_of(np.full((4, 20, 30), 2**31 - 1, np.int32)).any()
    assert not scores_of(np.zeros((4, 20, 30), np.int32), lags=[]).any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"corners": [(1, 0)]}, "windows: expected parts of an image of 20 x 30, got 20 x 30 at"),
        ({"corners": [(2**64 - 1, 0)]}, "windows"),
        ({"size": (0, 5)}, "windows"),
        ({"lags": [0]}, "lags: expected 1 to less than 4, the number of blocks, got 0"),
        ({"lags": [4]}, "lags"),
        ({"line": np.array([0, np.nan])}, "line and filters: expected finite numbers, got NaN"),
        ({"filters": (np.inf, 1.0)}, "line and filters"),
        ({"threads": 0}, "threads"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        scores_of(np.ones((4, 20, 30), np.int32), **arguments)


@pytest.mark.parametrize("stride", [24, 32])
@pytest.mark.parametrize("length", [1, 47, 48, 49, 80, 256])
def test_windows_cover_the_image(length, stride):
    starts = window_starts(length, stride)
    covered = np.zeros(length, bool)
    for start in starts:
        assert start >= 0
        assert start + min(WINDOW, length) <= length
        covered[start : start + WINDOW] = True
    assert covered.all()
    assert all(0 < step <= stride for step in np.diff(starts))


@pytest.mark.parametrize("shape", [(64, 100), (30, 60)])
def test_each_window_has_the_scores_of_its_part_alone(shape):
    blocks = np.random.default_rng(5).poisson(3, (5, *shape)).astype(np.int32)
    found = VelocityScores(blocks, 4, LAGS, 1)
    scores, centers = found.of_windows(24)
    half = np.minimum(shape, WINDOW)
    for window, center in zip(scores, centers, strict=True):
        row, column = (center / BIN + (np.array(shape) - half) / 2).astype(int)
        part = blocks[:, row : row + half[0], column : column + half[1]]
        alone = VelocityScores(np.ascontiguousarray(part), 4, LAGS, 1)
        np.testing.assert_array_equal(alone.line, found.line)
        np.testing.assert_allclose(window, alone.of_windows(24)[0][0], atol=1e-5)
