"""Velocities from the correlations of blocks, with known velocities and a slow correlation."""

import itertools

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.burst import as_burst
from jotlight.motion.velocity import (
    _STRIDE,
    _WINDOW,
    _interpolate,
    _scores,
    _starts,
    find_velocities,
)
from moving import as_burst_of, moved


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


def test_scores_are_largest_at_the_displacement_of_periodic_images():
    """The images repeat a random texture, so a slow search of the best shift is exact."""
    rng = np.random.default_rng(1)
    texture = rng.random((64, 64))
    images = np.stack([np.roll(texture, (2 * n, -3 * n), (0, 1)) for n in range(6)])
    line = np.arange(-8, 9) / 2
    (scores,) = _scores(images[None].astype(np.float32), [1, 2], line)
    row, column = np.unravel_index(scores.argmax(), scores.shape)
    best = max(
        ((y, x) for y in range(-4, 5) for x in range(-4, 5)),
        key=lambda shift: sum(
            (np.roll(one, shift, (0, 1)) * other).sum() for one, other in itertools.pairwise(images)
        ),
    )
    assert best == (2, -3)
    assert (line[row], line[column]) == best


def test_interpolation_is_periodic_and_linear():
    values, places = np.random.default_rng(2).random(10), np.array([0.0, 2.25, -0.5, 12.75, -10])
    expected = [np.interp(place % 10, np.arange(11), [*values, values[0]]) for place in places]
    found = _interpolate(values.reshape(1, 10, 1), places, 1, 10).ravel()
    np.testing.assert_allclose(found, expected, atol=1e-6)


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
