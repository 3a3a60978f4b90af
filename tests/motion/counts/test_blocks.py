"""Counts along a motion: the engine against its twin, and exact cases."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jotlight as jl
from jotlight import _engine as engine
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.burst import as_burst
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.track import Track
from moving import blocks_of
from reference.motion import interpolate_tiles, shifted_counts


def count(bits, fields, tile, times, valid=None, threads=None):
    """Return ones, trials, and remainders from the engine, for an array of bits."""
    fields = np.ascontiguousarray(fields)
    _, height, width = bits.shape
    ones, trials = np.zeros((2, height, width), np.int32)
    remainders = np.zeros((height, 2, -(-width // 16)), np.float32)
    mask = None if valid is None else np.packbits(valid, axis=1)
    engine.count_shifted(
        np.packbits(bits, axis=2), width, fields, tile, np.asarray(times, np.float64), mask,
        ones, trials, remainders, threads,
    )  # fmt: skip
    return ones, trials, remainders


@st.composite
def bursts(draw):
    """Draw bits, two fields of displacements, the width of tiles, times, and a mask."""
    frames, height = draw(st.integers(1, 20)), draw(st.integers(1, 40))
    width = draw(st.integers(1, 200) | st.sampled_from([64, 128, 512]))
    tile = draw(st.sampled_from([None, 1, 2, 7, 16]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    size = (height, width) if tile is None else (-(-height // tile), -(-width // tile))
    scale = draw(st.sampled_from([0.0, 0.3, 3.0, 50.0]))
    smooth = rng.normal(0, scale, (2, 2, 1, 1))
    fields = smooth + rng.normal(0, scale, (2, 2, *size)) * draw(st.sampled_from([0, 0.05, 1]))
    fields = np.where(draw(st.booleans()), fields, np.rint(fields * 2) / 2).astype(np.float32)
    bits = rng.random((frames, height, width)) < 0.4
    valid = None if draw(st.booleans()) else rng.random((height, width)) < 0.8
    return bits, *fields, tile, rng.uniform(-0.5, 1.5, frames).astype(np.float32), valid


@settings(max_examples=60)
@given(bursts())
def test_counts_are_those_of_the_twin(burst):
    bits, first, last, tile, times, valid = burst
    ones, trials, remainders = count(bits, (first, last), tile, times, valid)
    expected = shifted_counts(bits, first, last, tile, times, valid)
    np.testing.assert_array_equal(ones, expected[0])
    np.testing.assert_array_equal(trials, expected[1])
    scale = 1e-4 * len(times) * (1 + abs(np.stack([first, last])).max())
    np.testing.assert_allclose(remainders, expected[2], atol=scale)


@pytest.mark.parametrize("tile", [None, 16])
def test_constant_velocities_are_exact_at_halves(tile):
    bits = np.random.default_rng(0).random((33, 20, 70)) < 0.4
    first = np.full((2, 20, 70) if tile is None else (2, 2, 5), 4, np.float32)
    times = np.linspace(0, 1, 33)  # displacements are multiples of 1/4
    expected = shifted_counts(bits, first, -first, tile, times)[:2]
    np.testing.assert_array_equal(count(bits, (first, -first), tile, times)[:2], expected)


@given(bursts(), st.integers(1, 4))
def test_counts_are_the_same_for_any_number_of_threads(burst, threads):
    bits, first, last, tile, times, valid = burst
    whole = count(bits, (first, last), tile, times, valid, 1)
    for one, other in zip(
        whole, count(bits, (first, last), tile, times, valid, threads), strict=True
    ):
        np.testing.assert_array_equal(one, other)


@settings(max_examples=40)
@given(bursts(), st.integers(1, 5))
def test_motions_are_linear_between_two_fields(burst, number):
    bits, first, last, tile, times, valid = burst
    fields = np.stack([first, last, first + 1, -last, 2 * first])[:number]
    times = np.clip(times.astype(np.float64) * number, -1, number)
    found = count(bits, fields, tile, times, valid)
    index = np.clip(np.floor(times), 0, max(number - 2, 0)).astype(int)
    pairs = [(fields[n], fields[min(n + 1, number - 1)]) for n in index]
    frames = [
        shifted_counts(frame[None], *pair, tile, [time], valid)
        for frame, pair, time in zip(bits, pairs, times - index, strict=True)
    ]
    for engine_sum, expected in zip(found, map(sum, zip(*frames, strict=True)), strict=True):
        scale = 1e-4 * len(times) * (1 + abs(fields).max())
        np.testing.assert_allclose(engine_sum, expected, atol=scale)


def test_whole_shifts_give_the_sum_of_shifted_frames():
    rng = np.random.default_rng(0)
    bits = rng.random((9, 40, 150)) < 0.3
    for rows, columns in ((0, 0), (3, -7), (-40, 2), (5, 149), (1, 150), (-39, 64)):
        field = np.broadcast_to(np.float32([[[rows]], [[columns]]]), (2, 3, 10)).copy()
        ones, trials, remainders = count(bits, (field, field), 16, np.zeros(9))
        expected, inside = np.zeros((2, 40, 150), int)
        for y in range(40):
            for x in range(150):
                if 0 <= y + rows < 40 and 0 <= x + columns < 150:
                    expected[y, x] = bits[:, y + rows, x + columns].sum()
                    inside[y, x] = 9
        np.testing.assert_array_equal(ones, expected)
        np.testing.assert_array_equal(trials, inside)
        np.testing.assert_allclose(remainders, 0, atol=1e-4)


def test_reversed_time_gives_the_same_counts():
    rng = np.random.default_rng(1)
    bits, times = rng.random((20, 33, 70)) < 0.3, np.linspace(0, 1, 20)
    first, last = rng.normal(0, 4, (2, 2, 3, 5)).astype(np.float32)
    forward = count(bits, (first, last), 16, times)
    backward = count(bits[::-1], (last, first), 16, 1 - times[::-1])
    # In the other direction, rounding to float32 may move a displacement across a half.
    assert (forward[0] != backward[0]).mean() < 1e-3
    assert (forward[1] != backward[1]).mean() < 1e-3


def test_strided_bits_are_counted_like_contiguous_ones():
    rng = np.random.default_rng(2)
    color = rng.random((8, 20, 70, 3)) < 0.3
    packed = np.packbits(color, axis=2)
    field = rng.normal(0, 3, (2, 2, 5)).astype(np.float32)
    ones, trials = np.zeros((2, 20, 70), np.int32)
    remainders = np.zeros((20, 2, 5), np.float32)
    engine.count_shifted(
        packed[..., 1], 70, np.stack([field] * 2), 16, np.zeros(8), None, ones, trials,
        remainders, None,
    )  # fmt: skip
    np.testing.assert_array_equal(ones, count(color[..., 1], (field, field), 16, np.zeros(8))[0])


@pytest.mark.parametrize("frames", [0, 3])
@pytest.mark.parametrize("valid", [None, np.full((5, 3), 255, np.uint8)])
def test_counts_replace_earlier_values(frames, valid):
    bits = np.ones((frames, 5, 20), bool)
    field = np.zeros((2, 1, 2), np.float32)
    ones, trials = np.full((2, 5, 20), 10, np.int32)
    remainders = np.full((5, 2, 2), 10, np.float32)
    engine.count_shifted(
        np.packbits(bits, axis=2), 20, np.stack([field] * 2), 16, np.zeros(frames), valid, ones,
        trials, remainders, None,
    )  # fmt: skip
    assert (ones == frames).all()
    assert (trials == frames).all()
    assert (remainders == 0).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fields": np.zeros((2, 2, 2, 2), np.float32)}, "displacements"),
        (
            {"fields": np.zeros((0, 2, 1, 2), np.float32)},
            "fields of displacements: expected at least 1",
        ),
        ({"fields": np.full((2, 2, 1, 2), np.nan, np.float32)}, "displacements: expected numbers"),
        ({"fields": np.full((2, 2, 1, 2), 2e5, np.float32)}, "displacements: expected numbers"),
        ({"tile": 0}, "width of a tile: expected at least 1"),
        ({"times": np.zeros(2)}, "times of the frames"),
        ({"times": np.full(3, 2.5)}, "expected -1 to 2"),
        ({"times": np.full(3, np.nan)}, "expected -1 to 2"),
        ({"valid": np.zeros((5, 9), np.uint8)}, "packed mask"),
        ({"ones": np.zeros((5, 21), np.int32)}, "counts"),
        ({"trials": np.zeros((6, 20), np.int32)}, "counts"),
        ({"remainders": np.zeros((5, 2, 3), np.float32)}, "remainders"),
        ({"width": 30}, "bytes in a packed row"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(changes, message):
    arguments = {
        "packed": np.zeros((3, 5, 3), np.uint8),
        "width": 20,
        "fields": np.zeros((2, 2, 1, 2), np.float32),
        "tile": 16,
        "times": np.zeros(3),
        "valid": None,
        "ones": np.zeros((5, 20), np.int32),
        "trials": np.zeros((5, 20), np.int32),
        "remainders": np.zeros((5, 2, 2), np.float32),
        "threads": None,
    }
    with pytest.raises(ValueError, match=message):
        engine.count_shifted(*{**arguments, **changes}.values())


def test_blocks_return_remainders_per_frame():
    rng = np.random.default_rng(3)
    bits = jl.Bits.from_array(rng.random((12, 40, 50)) < 0.3)
    blocks = blocks_of(bits, 1)
    field = np.full((2, 3, 4), 0.25, np.float32)
    field[1] = -7.75
    sums = blocks.count(range(12), (field, field), (0, 12))
    # The shift is 0 rows and -8 columns.
    np.testing.assert_allclose(sums.remainders, -0.25 * 12, atol=1e-4)
    np.testing.assert_array_equal(sums.trials[:, :8], 0)
    np.testing.assert_array_equal(sums.ones[:, 8:], bits.to_array()[:, :, :42].sum(axis=0))
    both = sums + Sums.zeros((40, 50))
    np.testing.assert_array_equal(both.ones, sums.ones)
    assert both.frames == 12


def test_blocks_select_their_frames():
    rng = np.random.default_rng(4)
    bits = jl.Bits.from_array(rng.random((12, 16, 16)) < 0.3)
    blocks = Blocks(as_burst(bits), np.array([0, 4, 12]))
    assert blocks.centers.tolist() == [1.5, 7.5]
    field = np.zeros((2, 1, 1), np.float32)
    sums = blocks.count(range(4, 12), (field, field), (0, 12))
    np.testing.assert_array_equal(sums.ones, bits[4:12].counts(1))
    pixels = np.zeros((2, 16, 16), np.float32)
    np.testing.assert_array_equal(
        blocks.count(range(4, 12), (pixels,) * 2, (0, 12)).ones, sums.ones
    )


def test_tiles_and_pixels_agree():
    rng = np.random.default_rng(5)
    bits, times = rng.random((10, 40, 100)) < 0.3, np.linspace(0, 1, 10)
    first, last = rng.normal(0, 4, (2, 2, 3, 7)).astype(np.float32)
    pixels = [interpolate_tiles(field, 16, (40, 100)) for field in (first, last)]
    tiles, of_pixels = count(bits, (first, last), 16, times), count(bits, pixels, None, times)
    np.testing.assert_array_equal(tiles[0], of_pixels[0])
    np.testing.assert_array_equal(tiles[1], of_pixels[1])
    np.testing.assert_allclose(tiles[2], of_pixels[2], atol=1e-4)


@pytest.mark.parametrize(("frames", "middle"), [(1, 0), (16, 8), (17, 8)])
def test_a_motion_is_estimated_from_the_middle(frames, middle):
    blocks = blocks_of(jl.Bits.from_array(np.zeros((frames, 16, 16), bool)))
    assert blocks.middle == Track.still(blocks).reference == middle
