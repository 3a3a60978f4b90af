import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jotlight as jl
from jotlight.runs import streaming
from jotlight.runs.spans import Spans
from jotlight.runs.streaming import Checksum, WindowCounter
from jotlight.sensing.bits.frames import Frames


def random_frames(frames, height=4, width=11):
    return np.random.default_rng(frames).random((frames, height, width)) < 0.4


@given(
    frames=st.integers(1, 40),
    window=st.integers(1, 40),
    step=st.integers(1, 50),
    group=st.integers(1, 8),
)
@settings(max_examples=30, deadline=None)
def test_groups_of_windows_have_the_counts_and_the_checksum_of_the_whole(
    frames, window, step, group
):
    window = min(window, frames)
    unpacked = random_frames(frames)
    bits = jl.Bits.from_array(unpacked)
    packed = bits.packed
    lazy = jl.Bits(Frames(packed.shape, lambda start, stop: packed[start:stop]), bits.width)
    starts = range(0, frames - window + 1, step)
    spans = Spans(window, step, len(starts))
    found, total = [], Checksum()
    for first in range(0, len(starts), group):
        stop = min(first + group, len(starts))
        counter = WindowCounter(lazy, spans, 1, threads=1)
        read = [each.copy() for each in counter.windows(first, stop)]
        counter = WindowCounter(bits, spans, 1, threads=1)
        found += counter.windows(first, stop)
        total.append(counter.checksum.value, counter.checksum.size)
        np.testing.assert_array_equal(read, found[first:stop])
    expected = [unpacked[start : start + window].sum(0) for start in starts]
    np.testing.assert_array_equal(found, expected)
    used = np.unique([frame for start in starts for frame in range(start, start + window)])
    assert total.value == zlib.crc32(bits.packed[used].tobytes())
    assert total.size == bits.packed[used].nbytes


@pytest.mark.parametrize("step", [1, 30, 60])
@pytest.mark.parametrize(("kept", "most"), [(1 << 28, 1), (0, 4)])
def test_each_frame_is_read_once_if_those_of_a_window_fit_into_memory(
    step, kept, most, monkeypatch
):
    monkeypatch.setattr(streaming, "_MAX_KEPT_BYTES", kept)
    monkeypatch.setattr(streaming, "_MAX_BYTES", 7 * 4 * 2)
    reads = np.zeros(400, int)
    packed = np.packbits(random_frames(400), axis=2)

    def read(start, stop):
        reads[start:stop] += 1
        return packed[start:stop]

    bits = jl.Bits(Frames(packed.shape, read), 11)
    spans = Spans(100, step, 1 + 300 // step)
    counts = [each.copy() for each in WindowCounter(bits, spans, 1).windows(0, spans.number)]
    assert 1 <= reads.max() <= most
    starts = spans.starts.tolist()
    expected = [bits[start : start + 100].counts() for start in starts]
    np.testing.assert_array_equal(counts, expected)


def test_parts_in_memory_are_small(monkeypatch):
    sizes = []
    packed = np.packbits(random_frames(400), axis=2)

    def read(start, stop):
        sizes.append(stop - start)
        return packed[start:stop]

    bits = jl.Bits(Frames(packed.shape, read), 11)
    monkeypatch.setattr(streaming, "_MAX_BYTES", packed[:7].nbytes)
    counts = next(WindowCounter(bits, Spans(400, 400, 1), 1).windows(0, 1))
    np.testing.assert_array_equal(counts, random_frames(400).sum(0))
    assert max(sizes) == 7


def test_color_and_oversampling():
    unpacked = np.random.default_rng(0).random((20, 8, 16, 3)) < 0.4
    counter = WindowCounter(jl.Bits.from_array(unpacked), Spans(10, 10, 2), 2)
    expected = unpacked.reshape(2, 10, 4, 2, 8, 2, 3).sum((1, 3, 5))
    np.testing.assert_array_equal(list(counter.windows(0, 2)), expected)
