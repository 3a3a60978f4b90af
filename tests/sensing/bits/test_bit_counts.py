"""Counts of the ones of packed bits."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.bits.counting import count_ones
from reference.sensing import block_counts

RANDOM = np.random.default_rng(0)


def random_bits(*shape):
    return RANDOM.random(shape) < 0.4


def sides():
    """Yield sides of squares. The fast ones are small, or about the bits of a word or a byte."""
    for side in (*range(1, 71), 113, 128):
        is_fast = side < 18 or side == 113 or side % 32 in (31, 0, 1)
        yield pytest.param(side, marks=[] if is_fast else pytest.mark.slow)


@pytest.mark.parametrize("side", list(sides()))
def test_counts_are_those_of_the_definition(side):
    array = random_bits(3, 2 * side, 3 * side)
    mask = random_bits(2 * side, 3 * side)
    bits = jl.Bits.from_array(array)
    counts = bits.counts(side)
    assert counts.dtype == np.int32
    np.testing.assert_array_equal(counts, block_counts(array, side))
    np.testing.assert_array_equal(bits.counts(side, mask=mask), block_counts(array, side, mask))


@pytest.mark.parametrize("frames", [1, 254, 255, 256, 511, 1000])
@pytest.mark.parametrize("side", [1, 2])
def test_counts_of_many_frames_do_not_overflow(frames, side):
    array = np.ones((frames, 4, 22), bool)
    array[:, 1, 3] = random_bits(frames)
    counts = jl.Bits.from_array(array).counts(side)
    np.testing.assert_array_equal(counts, block_counts(array, side))


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("side", [1, 3])
def test_counts_are_the_same_for_any_number_of_threads(threads, side):
    array = random_bits(300, 99, 27)
    counts = jl.Bits.from_array(array).counts(side, threads=threads)
    np.testing.assert_array_equal(counts, block_counts(array, side))


@pytest.mark.parametrize("side", [1, 3, 7])
@pytest.mark.parametrize("masked", [False, True])
def test_ones_in_the_padding_are_never_counted(side, masked):
    array = random_bits(4, 21, 21)
    mask = random_bits(21, 21) if masked else None
    packed = np.packbits(array, axis=2)
    packed[..., -1] |= 0b00000111
    bits = jl.Bits(packed, width=21)
    np.testing.assert_array_equal(bits.counts(side, mask=mask), block_counts(array, side, mask))
    np.testing.assert_array_equal(bits.to_array(), array)


@pytest.mark.parametrize("side", [1, 5])
def test_color_channels_are_counted_separately(side):
    array = random_bits(3, 10, 35, 3)
    mask = random_bits(10, 35)
    counts = jl.Bits.from_array(array).counts(side, mask=mask)
    assert counts.shape == (10 // side, 35 // side, 3)
    for channel in range(3):
        expected = block_counts(array[..., channel], side, mask)
        np.testing.assert_array_equal(counts[..., channel], expected)


def memory_map(packed, folder):
    np.save(folder / "cube.npy", packed)
    return np.load(folder / "cube.npy", mmap_mode="r")


@pytest.mark.parametrize("side", [1, 3])
@pytest.mark.parametrize(
    "layout",
    [
        memory_map,
        lambda packed, folder: np.asfortranarray(packed),
        lambda packed, folder: packed[::-1].copy()[::-1],
        lambda packed, folder: np.repeat(packed, 2, axis=2)[:, :, ::2],
        lambda packed, folder: np.stack([packed, packed], axis=3)[..., 1],
        lambda packed, folder: np.frombuffer(packed.tobytes(), np.uint8).reshape(packed.shape),
    ],
    ids=["memmap", "fortran", "reversed", "strided", "channel", "read-only"],
)
def test_the_layout_of_the_bytes_does_not_matter(layout, side, tmp_path):
    array = random_bits(4, 6, 21)
    mask = random_bits(6, 21)
    bits = jl.Bits(layout(np.packbits(array, axis=2), tmp_path), width=21)
    np.testing.assert_array_equal(bits.counts(side), block_counts(array, side))
    np.testing.assert_array_equal(
        bits.counts(side, mask=np.asfortranarray(mask)), block_counts(array, side, mask)
    )
    np.testing.assert_array_equal(bits.to_array(), array)


def test_counts_report_their_progress_and_do_not_depend_on_the_chunks(monkeypatch):
    array = random_bits(7, 20, 12, 2)
    bits = jl.Bits.from_array(array)
    whole = bits.counts(4)
    monkeypatch.setattr("jotlight.sensing.bits.counting._MAX_JOTS_IN_MEMORY", 100)
    monkeypatch.setattr("jotlight.chunks._MIN_ROW_COST", 1)
    done = []
    np.testing.assert_array_equal(bits.counts(4, progress=done.append), whole)
    assert done == sorted(set(done))
    assert len(done) > 20
    assert done[-1] == 1


def test_the_oversampling_of_counts_is_that_of_the_sensor_or_one():
    array = random_bits(2, 6, 9)
    sensor = jl.Sensor(oversampling=3, frames=2)
    np.testing.assert_array_equal(
        jl.Bits.from_array(array, sensor).counts(), block_counts(array, 3)
    )
    np.testing.assert_array_equal(jl.Bits.from_array(array).counts(), array.sum(axis=0))


@pytest.mark.parametrize(
    ("side", "error", "message"),
    [
        (0, ValueError, "at least 1, got 0"),
        (-1, ValueError, "at least 1, got -1"),
        (2.0, TypeError, r"a whole number, got 2\.0"),
        ("2", TypeError, "a whole number, got '2'"),
    ],
)
def test_an_oversampling_that_is_no_number_of_jots_is_refused(side, error, message):
    bits = jl.Bits.from_array(random_bits(3, 4, 6))
    for call in (bits.counts, lambda each: count_ones([bits], each)):
        with pytest.raises(error, match=f"^oversampling: expected {message}"):
            call(side)


@pytest.mark.parametrize("side", [3, 4, 8])
def test_pixels_that_do_not_fill_the_frame_are_refused(side):
    with pytest.raises(ValueError, match=f"multiples of the oversampling {side}, got 4 x 6"):
        jl.Bits.from_array(random_bits(3, 4, 6)).counts(side)


@pytest.mark.parametrize(
    "mask",
    [
        np.zeros((4, 7), bool),
        np.zeros((6, 4), bool),
        np.zeros((1, 4, 6), bool),
        np.zeros((4, 6), np.uint8),
        np.zeros((4, 6)),
    ],
)
def test_a_mask_that_does_not_fit_is_refused(mask):
    with pytest.raises(ValueError, match=r"mask: expected bool of shape \(4, 6\), got"):
        jl.Bits.from_array(random_bits(3, 4, 6)).counts(mask=mask)


@pytest.mark.parametrize(("frames", "oversampling"), [(2**31, 1), (2**29, 2)])
def test_counts_that_could_exceed_their_type_are_refused(frames, oversampling):
    bits = jl.Bits(np.broadcast_to(np.uint8(255), (frames, oversampling, 1)))
    with pytest.raises(ValueError, match=r"bits: expected fewer than 2\*\*31 trials per pixel"):
        bits.counts(oversampling)
