"""Velocities from the correlations of blocks, with known velocities and a slow correlation."""

import itertools

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.formats.capture import CountStack
from jotlight.motion.burst import as_burst
from jotlight.motion.velocity import (
    _BAND,
    _LAGS,
    _STRIDE,
    _WINDOW,
    _count_blocks,
    _starts,
    find_velocities,
)
from jotlight.sensing.provenance import Provenance
from moving import as_burst_of, moved
from reference import motion as reference


def distances(found, velocity):
    """Return the largest distance of each field from a velocity in pixels per frame."""
    return np.hypot(*np.moveaxis(found - np.reshape(velocity, (2, 1, 1)), 1, 0)).max(axis=(1, 2))


@pytest.mark.parametrize(
    "velocity",
    [(1.0, -0.5)]
    + [pytest.param(each, marks=pytest.mark.slow) for each in ((0, 0), (-0.17, 1.9), (0.02, 0.04))],
)
def test_the_velocity_of_dim_frames_is_found(velocity):
    shifts = np.outer(np.arange(64) - 32, velocity)
    bits = moved(shifts, shape=(112, 96), photons=0.1, rng=0)[1]
    found = find_velocities(as_burst(bits), 32, 2)
    assert not found[0].any()
    assert distances(found, velocity).min() < 0.08


@pytest.mark.slow
def test_two_parts_have_two_velocities():
    left, right = (
        moved(np.outer(np.arange(64) - 32, velocity), shape=(96, 96), photons=0.3, rng=0)[1]
        for velocity in ((0.5, 0.3), (-0.4, 0.6))
    )
    both = np.concatenate([left.to_array(), right.to_array()], axis=2)
    found = find_velocities(as_burst_of(both), 32, None)
    for velocity in ((0.5, 0.3), (-0.4, 0.6)):
        assert distances(found, velocity).min() < 0.08


@pytest.mark.parametrize("value", [False, True])
def test_bits_that_are_all_equal_do_not_move(value):
    bits = jl.Bits.from_array(np.full((32, 40, 48), value))
    np.testing.assert_array_equal(find_velocities(as_burst(bits), 16, 1), np.zeros((1, 2, 3, 3)))


@pytest.mark.parametrize("reference", [0, 1, 2, 31, 32])
def test_any_reference_time_gives_finite_velocities(reference):
    rng = np.random.default_rng(0)
    burst = as_burst_of(rng.random((32, 20, 30)) < 0.3)
    found = find_velocities(burst, reference, None)
    assert np.isfinite(found).all()
    assert not found[0].any()


def scores_of(blocks, **arguments):
    """Return the scores of windows, by default of the whole image."""
    rest = {
        "corners": [(0, 0)], "size": blocks.shape[1:], "filters": _BAND, "lags": [1, 2],
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
    lags = [lag for lag in _LAGS if lag < number]
    line = np.linspace(-0.45, 0.47, 17) * max(2, *size) / lags[-1]
    window = {"corners": corners, "size": size, "lags": lags, "line": line}
    engine.choose_cpu_level(level)
    try:
        scores, *others = (scores_of(blocks, **window, threads=threads) for threads in (1, 2, 3))
    finally:
        engine.choose_cpu_level(None)
    expected = reference.velocity_scores(blocks, corners, size, _BAND, lags, line)
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


def slow_counts(images, reference_time, length):
    """Return the sums of squares of two pixels in up to 32 blocks around a time."""
    number = min(32, 2 * (min(reference_time, len(images) - reference_time) // length))
    start = reference_time - number // 2 * length
    blocks = np.asarray(images[start : start + number * length], np.int64)
    _, height, width = blocks.shape
    blocks = blocks[:, : height // 2 * 2, : width // 2 * 2]
    return blocks.reshape(number, length, height // 2, 2, width // 2, 2).sum(axis=(1, 3, 5))


@pytest.mark.parametrize(("reference_time", "length"), [(40, 1), (30, 3), (41, 20), (50, 2)])
@pytest.mark.parametrize("kind", ["bits", "colors", "counts"])
def test_blocks_are_counted_in_squares(kind, reference_time, length, monkeypatch):
    rng = np.random.default_rng(5)
    shape = (81, 13, 19, 3) if kind == "colors" else (81, 13, 19)
    if kind == "counts":
        images = rng.integers(0, 12, shape, np.uint8)
        burst = as_burst(CountStack(images, Provenance("npy", "a"), 11))
    else:
        images = rng.random(shape) < 0.4
        burst = as_burst(jl.Bits.from_array(images))
    expected = images.sum(axis=3) if kind == "colors" else images
    # Each part has a few frames, so blocks consist of several parts, and parts of several blocks.
    monkeypatch.setattr("jotlight.motion.burst._BYTES_AT_ONCE", 7 * burst.frame_bytes)
    for threads in (1, 2):
        counts = _count_blocks(burst, reference_time, length, threads)
        np.testing.assert_array_equal(counts, slow_counts(expected, reference_time, length))


def test_thin_images_are_counted_jot_by_jot():
    images = np.random.default_rng(6).random((8, 2, 11)) < 0.5
    counts = _count_blocks(as_burst_of(images), 4, 2, None)
    np.testing.assert_array_equal(counts, images.reshape(4, 2, 2, 11).sum(axis=1))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"side": 0}, "oversampling"),
        ({"side": 3}, "rows and columns of jots"),
        ({"length": 0}, "blocks: expected at least 1, got a length of 0"),
        ({"weight": 0}, "weight of 0"),
        ({"before": 3}, "frames: expected at most 2 blocks of 4, got 6 after 3"),
        ({"before": 2**64 - 1}, "frames"),
        ({"weight": 2**31 - 1}, "sums of less than"),
        ({"counts": np.zeros((2, 4, 4), np.int32)}, "counts"),
        ({"width": 17}, "bytes in a packed row"),
    ],
)
def test_wrong_blocks_are_refused(arguments, message):
    rest = {
        "packed": np.full((6, 4, 1), 255, np.uint8), "width": 8, "side": 2, "before": 0,
        "length": 4, "weight": 1, "counts": np.zeros((2, 2, 4), np.int32), "threads": 1,
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        engine.add_counts_of_blocks(*(rest | arguments).values())


@pytest.mark.parametrize("length", [1, 47, 48, 49, 80, 256])
def test_windows_cover_the_image(length):
    starts = _starts(length)
    covered = np.zeros(length, bool)
    for start in starts:
        assert start >= 0
        assert start + min(_WINDOW, length) <= length
        covered[start : start + _WINDOW] = True
    assert covered.all()
    assert all(0 < step <= _STRIDE for step in np.diff(starts))
