"""Velocities from the correlations of blocks, with known velocities."""

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.formats.capture import CountStack
from jotlight.motion.counts.block_edges import block_edges
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.burst import as_burst
from jotlight.motion.displacements.velocity import _count_blocks, find_velocities
from jotlight.sensing.parameters.provenance import Provenance
from moving import as_burst_of, blocks_of, moved


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
    found = find_velocities(blocks_of(bits, threads=2))
    assert not found[0].any()
    assert distances(found, velocity).min() < 0.08


@pytest.mark.slow
def test_two_parts_have_two_velocities():
    left, right = (
        moved(np.outer(np.arange(64) - 32, velocity), shape=(96, 96), photons=0.3, rng=0)[1]
        for velocity in ((0.5, 0.3), (-0.4, 0.6))
    )
    both = np.concatenate([left.to_array(), right.to_array()], axis=2)
    found = find_velocities(blocks_of(jl.Bits.from_array(both)))
    for velocity in ((0.5, 0.3), (-0.4, 0.6)):
        assert distances(found, velocity).min() < 0.08


@pytest.mark.parametrize("value", [False, True])
def test_bits_that_are_all_equal_do_not_move(value):
    bits = jl.Bits.from_array(np.full((32, 40, 48), value))
    np.testing.assert_array_equal(
        find_velocities(blocks_of(bits, threads=1)), np.zeros((1, 2, 3, 3))
    )


@pytest.mark.parametrize("frames", [1, 2, 3, 31, 32])
def test_any_number_of_frames_gives_finite_velocities(frames):
    rng = np.random.default_rng(0)
    bits = jl.Bits.from_array(rng.random((frames, 20, 30)) < 0.3)
    found = find_velocities(blocks_of(bits))
    assert np.isfinite(found).all()
    assert not found[0].any()


def slow_counts(images, length):
    """Return the sums of squares of two pixels in up to 32 blocks around the middle."""
    middle = len(images) // 2
    number = min(32, 2 * (middle // length))
    start = middle - number // 2 * length
    blocks = np.asarray(images[start : start + number * length], np.int64)
    _, height, width = blocks.shape
    blocks = blocks[:, : height // 2 * 2, : width // 2 * 2]
    return blocks.reshape(number, length, height // 2, 2, width // 2, 2).sum(axis=(1, 3, 5))


@pytest.mark.parametrize("length", [1, 2, 3, 20])
@pytest.mark.parametrize("kind", ["bits", "colors", "counts"])
def test_blocks_are_counted_in_squares(kind, length, monkeypatch):
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
    monkeypatch.setattr("jotlight.motion.counts.burst._BYTES_AT_ONCE", 7 * burst.frame_bytes)
    for threads in (1, 2):
        blocks = Blocks(burst, block_edges(len(burst)), threads=threads)
        counts = _count_blocks(blocks, length)
        np.testing.assert_array_equal(counts, slow_counts(expected, length))


def test_thin_images_are_counted_jot_by_jot():
    images = np.random.default_rng(6).random((8, 2, 11)) < 0.5
    burst = as_burst_of(images)
    counts = _count_blocks(Blocks(burst, block_edges(len(burst))), 2)
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
