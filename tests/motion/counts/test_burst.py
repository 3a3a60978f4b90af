"""Bursts: bits, colors, and counts as planes of bits."""

import tracemalloc

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.motion.counts import burst as module
from jotlight.motion.counts import kept_sums
from jotlight.motion.counts.burst import as_burst
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.provenance import Provenance

PROVENANCE = Provenance("npy", "counts.npy")
RNG = np.random.default_rng(0)
BITS = RNG.random((9, 12, 21)) < 0.3
COLOR = RNG.random((9, 12, 21, 3)) < 0.3
COUNTS = RNG.integers(0, 8, (9, 12, 21), np.uint8)
COLOR_COUNTS = RNG.integers(0, 8, (9, 12, 21, 3), np.uint8)


def content(burst, frames, channel=None):
    """Return the counts of frames, (T, H, W), from the planes of a burst."""
    parts = []
    for part, planes in burst.parts(frames, channel):
        images = np.zeros((len(part), *burst.size), int)
        for weight, packed in planes:
            assert packed[0].flags.c_contiguous
            digits = np.unpackbits(packed, axis=2, count=burst.size[1])
            images += weight * digits.astype(int)
        parts.append(images)
    return np.concatenate(parts)


CASES = {
    "bits": (jl.Bits.from_array(BITS), BITS, 1, 1),
    "color": (jl.Bits.from_array(COLOR), COLOR.sum(axis=3), 3, 3),
    "counts": (CountStack(COUNTS, PROVENANCE, 7), COUNTS, 7, 1),
    "counts of colors": (CountStack(COLOR_COUNTS, PROVENANCE, 7), COLOR_COUNTS.sum(axis=3), 21, 3),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("bytes_at_once", [1, 100, 1 << 25])
def test_planes_add_up_to_the_counts(name, bytes_at_once, monkeypatch):
    monkeypatch.setattr(module, "_BYTES_AT_ONCE", bytes_at_once)
    data, expected, trials, channels = CASES[name]
    burst = as_burst(data)
    assert (len(burst), burst.size, burst.trials, burst.channels) == (9, (12, 21), trials, channels)
    np.testing.assert_array_equal(content(burst, range(9)), expected)
    np.testing.assert_array_equal(content(burst, range(2, 7)), expected[2:7])
    np.testing.assert_array_equal(burst.counts(range(3, 8), 2), expected[3:8].sum(axis=0))


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("bytes_at_once", [1, 1 << 25])
@pytest.mark.parametrize("step", [2, 3, 20])
def test_every_nth_frame_can_be_read(name, bytes_at_once, step, monkeypatch):
    monkeypatch.setattr(module, "_BYTES_AT_ONCE", bytes_at_once)
    data, expected, *_ = CASES[name]
    found = content(as_burst(data), range(1, 9, step))
    np.testing.assert_array_equal(found, expected[1:9:step])


@pytest.mark.parametrize("name", ["color", "counts of colors"])
def test_channels_can_be_read_alone(name):
    burst = as_burst(CASES[name][0])
    whole = {"color": COLOR, "counts of colors": COLOR_COUNTS}[name]
    for channel in range(3):
        found = content(burst, range(9), channel)
        np.testing.assert_array_equal(found, whole[..., channel])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.int64, ">u2"])
def test_counts_may_have_any_type_of_integers(dtype):
    stack = CountStack((COUNTS.astype(int) * 1000).astype(dtype), PROVENANCE, 8000)
    if np.dtype(dtype).itemsize > 1:
        np.testing.assert_array_equal(content(as_burst(stack), range(9)), 1000 * COUNTS.astype(int))


def test_counts_must_state_their_trials():
    with pytest.raises(ValueError, match=r"counts\.npy: holds counts of an unknown number of tri"):
        as_burst(CountStack(COUNTS, PROVENANCE))


@pytest.mark.parametrize("data", [BITS, COUNTS, None, "bits", jl.Sensor()])
def test_other_data_are_refused(data):
    with pytest.raises(TypeError, match=r"data: expected jotlight\.Bits, or images of counts that"):
        as_burst(data)


def test_counts_in_an_array_are_taken_as_the_error_says(tmp_path):
    sensor = jl.Sensor(frames=7 * len(COUNTS))
    for function in (jl.merge, jl.align):
        with pytest.raises(TypeError, match=r'open_capture\("counts\.npy", counts=True\) reads'):
            function(COUNTS, sensor)
    np.save(tmp_path / "counts.npy", COUNTS)
    stack = jl.formats.open_capture(tmp_path / "counts.npy", counts=True)
    burst = as_burst(stack.with_trials_of(sensor))
    np.testing.assert_array_equal(content(burst, range(len(COUNTS))), COUNTS)


def test_sums_that_exceed_the_range_of_counts_are_refused():
    images = np.broadcast_to(np.uint16(3), (40_000, 2, 2))
    with pytest.raises(ValueError, match=r"expected fewer than 2\*\*31 readings .*got 2621400000"):
        as_burst(CountStack(images, PROVENANCE, 65_535))


@pytest.mark.parametrize("value", [-1, 8])
def test_counts_outside_of_the_range_are_refused(value):
    images = COUNTS.astype(int)
    images[4, 5, 6] = value
    burst = as_burst(CountStack(images, PROVENANCE, 7))
    with pytest.raises(ValueError, match=r"counts\.npy: expected counts from 0 to 7, the trials"):
        burst.counts(range(9), None)


def test_frames_are_read_when_they_are_needed():
    packed, read = np.packbits(BITS, axis=2), []

    def read_frames(start, stop):
        read.append((start, stop))
        return packed[start:stop]

    burst = as_burst(jl.Bits(Frames(packed.shape, read_frames), 21))
    assert read == []
    np.testing.assert_array_equal(content(burst, range(2, 5)), BITS[2:5])
    assert read == [(2, 5)]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the motion does not explain the scene")
def test_long_bursts_take_no_more_memory_than_short_ones(monkeypatch):
    monkeypatch.setattr(module, "_BYTES_AT_ONCE", 1 << 16)
    monkeypatch.setattr(kept_sums, "_MAX_KEPT_BYTES", 0)
    rng = np.random.default_rng(1)
    texture = rng.random((60, 60)) < 0.5
    shifts = *range(16), *range(16, 0, -1)
    still = np.stack([np.packbits(np.roll(texture, n, 1)[:48, :48], axis=1) for n in shifts])
    noise = np.packbits(rng.random((257, 48, 48)) < 0.3, axis=2)

    def record(frames):
        def read(start, stop):
            times = np.arange(start, stop)
            return still[times * 32 // frames] & noise[times % 257]

        return jl.Bits(Frames((frames, 48, 6), read), 48)

    jl.merge(record(1000))  # loads the networks
    peaks = []
    for frames in (1000, 3000):
        bits = record(frames)
        tracemalloc.start()
        merged = jl.merge(bits)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert 0 < merged.trials.min() <= merged.trials.max() <= frames
    # The displacements and the accepted pixels of each block remain in memory: a few kB each. The
    # bits of 2000 frames take 0.6 MB.
    assert peaks[1] < peaks[0] + 0.25e6
