"""Segments: which parts of a scene move differently."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import jotlight as jl
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.displacements import segments as module
from jotlight.motion.displacements.segments import (
    _energy,
    _majority,
    _Scene,
    count_at_velocity,
    energy_of,
    find_segments,
    limit_length,
    refine_velocity,
)
from jotlight.motion.tiles import tile_counts
from moving import as_burst_of, blocks_of, moved, record, two_halves


def field_of(velocity, blocks):
    field = np.asarray(velocity, float).reshape(2, 1, 1)
    return np.broadcast_to(field, (2, *tile_counts(blocks.size))).copy()


def test_the_strongest_segment_has_the_velocity_of_the_camera():
    scene, bits = record("shake", photons=0.3)
    segments = find_segments(blocks_of(bits))[0]
    # The velocity changes with time, so a few tiles may fit another constant one.
    assert segments[0].weights.mean() > 0.6
    assert segments[0].energy == max(segment.energy for segment in segments)
    speed = (scene.motion(28) - scene.motion(20))[:, 0, 0] / 8
    np.testing.assert_allclose(segments[0].velocity.mean(axis=(1, 2)), speed, atol=0.1)


@pytest.mark.slow
def test_halves_that_move_differently_are_two_segments():
    velocities = (0.4, 0.3), (-0.3, 0.5)
    bits = two_halves(velocities, 48)
    segments = find_segments(blocks_of(bits))[0]
    assert len(segments) >= 2
    # The border is between the columns 5 and 6 of tiles.
    for velocity, inner in zip(velocities, (slice(1, 5), slice(7, 11)), strict=True):
        largest = max(segments, key=lambda each: each.weights[:, inner].sum())
        assert largest.weights[:, inner].mean() > 0.8
        found = largest.velocity[:, :, inner].mean(axis=(1, 2))
        np.testing.assert_allclose(found, velocity, atol=0.05)
    total = np.sum([segment.weights for segment in segments], axis=0)
    assert total.max() == 1
    assert total.mean() > 0.9


@pytest.mark.slow
def test_velocities_that_hardly_differ_are_found_in_all_frames():
    """In the central half, the parts move apart by 10 pixels: less than their details are wide."""
    velocities = (0.1, 0.1), (-0.1, -0.1)
    blocks = blocks_of(two_halves(velocities, 96))
    for is_slow in (False, True):
        segments = find_segments(blocks, is_slow=is_slow)[0]
        found = [segment.velocity.mean(axis=(1, 2)) for segment in segments]
        errors = [min(abs(each - velocity).max() for each in found) for velocity in velocities]
        assert (max(errors) < 0.02) == is_slow


def test_the_energy_is_largest_at_the_true_velocity():
    velocity = 0.5, -0.25
    bits = moved(np.outer(np.arange(48) - 24, velocity), shape=(80, 80), photons=0.3, rng=0)[1]
    blocks = blocks_of(bits)
    energies = {
        (rows, columns): _energy(_Scene(blocks, 12), field_of((rows, columns), blocks)).mean()
        for rows in (0.3, 0.5, 0.7)
        for columns in (-0.45, -0.25, -0.05)
    }
    assert max(energies, key=energies.get) == (0.5, -0.25)


def test_the_energy_of_noise_is_about_zero_and_that_of_details_is_their_power():
    rng = np.random.default_rng(0)
    flat = blocks_of(jl.Bits.from_array(rng.random((64, 160, 160)) < 0.3))
    still = field_of((0, 0), flat)
    noise = 1 / 32 / (4 * np.pi * 1.5**2)
    assert abs(_energy(_Scene(flat, 16), still).mean()) < 0.1 * noise
    texture = gaussian_filter(rng.normal(size=(80, 80)), 2)
    p = 0.3 + 0.05 * texture / texture.std()
    blocks = blocks_of(jl.Bits.from_array(rng.random((64, 80, 80)) < p))
    power = gaussian_filter(p - gaussian_filter(p, 6), 1.5)[8:-8, 8:-8].var()
    assert _energy(_Scene(blocks, 16), still).mean() == pytest.approx(power / (0.3 * 0.7), rel=0.15)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_majority_is_that_of_a_loop(number):
    energies = list(np.random.default_rng(number).normal(size=(number, 5, 7)))
    best = np.argmax(energies, axis=0)
    expected = np.zeros((5, 7), int)
    for row, column in np.ndindex(5, 7):
        rows = np.clip([row - 1, row, row + 1], 0, 4)
        columns = np.clip([column - 1, column, column + 1], 0, 6)
        votes = np.bincount(best[np.ix_(rows, columns)].ravel(), minlength=number)
        expected[row, column] = votes.argmax()
    np.testing.assert_array_equal(_majority(energies), expected)


def test_a_velocity_is_refined():
    velocity = 0.5, -0.25
    bits = moved(np.outer(np.arange(48) - 24, velocity), shape=(80, 80), photons=0.3, rng=0)[1]
    blocks = blocks_of(bits)
    start = field_of((0.56, -0.3), blocks)
    found = refine_velocity(blocks, start, np.ones(tile_counts(blocks.size)))
    np.testing.assert_allclose(found.mean(axis=(1, 2)), velocity, atol=0.02)


@pytest.mark.parametrize(("share", "frames"), [(1.0, 96), (0.25, 192)])
def test_the_velocity_of_a_large_region_is_refined_with_few_frames(share, frames, monkeypatch):
    """4 times 1.5 ones per pixel of 65,536 pixels suffice, and 32 ones per pixel always do."""
    # All eight blocks have the same bits, which are drawn only once.
    bits = np.packbits(np.random.default_rng(2).random((96, 256, 256)) < 1 / 16, axis=2)
    blocks = blocks_of(jl.Bits(np.tile(bits, (8, 1, 1)), 256), 8)
    monkeypatch.setattr(Blocks, "mean_count", 1 / 16)
    monkeypatch.setattr(module, "_MAX_COUNTED", 192)
    counted = []

    def count(blocks, frames, fields, times):
        counted.append(len(frames))
        return count_all(blocks, frames, fields, times)

    count_all = Blocks.count
    monkeypatch.setattr(Blocks, "count", count)
    weights = np.zeros(tile_counts(blocks.size))
    weights[:, : round(16 * share)] = 1
    refine_velocity(blocks, field_of((0, 0.01), blocks), weights)
    assert counted == [96] * 4 + [frames] * 4


def test_frames_at_a_whole_velocity_are_shifted_and_added():
    rng = np.random.default_rng(1)
    bits = rng.random((10, 30, 40)) < 0.4
    blocks = blocks_of(jl.Bits.from_array(bits), 2)
    sums = count_at_velocity(blocks, range(2, 9), field_of((1, -2), blocks))
    expected, trials = np.zeros((30, 40), int), np.zeros((30, 40), int)
    for frame in range(2, 9):
        for row, column in np.ndindex(30, 40):
            y, x = row + (frame - 5), column - 2 * (frame - 5)
            if 0 <= y < 30 and 0 <= x < 40:
                expected[row, column] += bits[frame, y, x]
                trials[row, column] += 1
    np.testing.assert_array_equal(sums.ones, expected)
    np.testing.assert_array_equal(sums.trials, trials)


def test_long_vectors_are_shortened_and_short_ones_are_kept():
    vectors = np.array([[3.0, 0.3, 0], [4, 0.4, 0]])
    np.testing.assert_allclose(limit_length(vectors, 1), [[0.6, 0.3, 0], [0.8, 0.4, 0]])


@pytest.mark.parametrize("value", [False, True])
def test_bits_that_are_all_equal_are_one_segment_that_stands_still(value):
    from jotlight.motion.counts.blocks import Blocks

    burst = as_burst_of(np.full((32, 40, 40), value))
    ((segment,),) = find_segments(Blocks(burst, np.arange(0, 33, 2)))
    np.testing.assert_allclose(segment.velocity, 0, atol=1e-6)


def test_a_velocity_whose_frames_leave_the_view_has_no_energy():
    """One frame has much noise, of which the energy would be that of clear details."""
    bits = jl.Bits.from_array(np.random.default_rng(3).random((64, 64, 96)) < 0.2)
    blocks = blocks_of(bits)
    still = np.zeros((2, 4, 6))
    away = still + np.array([0.0, 100.0]).reshape(2, 1, 1)
    frames = range(16, 48)
    noise = energy_of(count_at_velocity(blocks, frames, still), None)
    lost = energy_of(count_at_velocity(blocks, frames, away), None)
    assert abs(lost).max() < 0.1 * abs(noise).max()
