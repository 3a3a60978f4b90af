"""The newest frames of a live capture."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jotlight.formats.format import FrameLayout
from jotlight.view.live.ring import FrameRing
from jotlight.view.viewed import FramesGoneError

LAYOUT = FrameLayout((2, 1), 8, 2, lambda raw: raw.reshape(-1, 2, 1))


@given(st.lists(st.integers(1, 9), max_size=30), st.integers(8, 60))
def test_the_ring_holds_the_newest_frames(sizes, max_bytes):
    ring, model = FrameRing(LAYOUT, max_bytes), np.zeros((0, 2, 1), np.uint8)
    rng = np.random.default_rng(0)
    for size in sizes:
        frames = rng.integers(0, 256, (size, 2, 1), np.uint8)
        ring.append(frames)
        model = np.concatenate([model, frames])
        available = ring.frames
        assert available.stop == len(model)
        assert len(available) <= ring.capacity
        # The next chunk needs room, which a reader takes before the bytes arrive.
        assert len(available) >= min(len(model), ring.capacity - ring.capacity // 4 - 1)
        np.testing.assert_array_equal(ring.read(available), model[available.start :])


@given(st.lists(st.integers(1, 5), min_size=1, max_size=40))
def test_bytes_may_arrive_in_parts(sizes):
    ring, stream = FrameRing(LAYOUT, 1000), np.arange(200, dtype=np.uint8)
    done = 0
    for size in sizes:
        memory = ring.reserve()
        size = min(size, len(memory))
        memory[:size] = stream[done : done + size].data
        ring.commit(size)
        done += size
        assert ring.frames == range(done // 2)
        assert ring.partial_bytes == done % 2
    if ring.frames:
        np.testing.assert_array_equal(ring.read(ring.frames).ravel(), stream[: done // 2 * 2])


def test_frames_that_are_gone_or_have_not_arrived_are_refused():
    ring = FrameRing(LAYOUT, 20)
    ring.append(np.zeros((25, 2, 1), np.uint8))
    for frames in (range(2), range(20, 26), range(24, 24)):
        with pytest.raises(FramesGoneError, match="not in memory"):
            ring.read(frames)


def test_skipped_frames_are_numbered():
    ring = FrameRing(LAYOUT, 100)
    ring.append(np.full((5, 2, 1), 1, np.uint8))
    ring.skip(7)
    ring.append(np.full((2, 2, 1), 9, np.uint8))
    assert ring.frames == range(12, 14)
    assert (ring.read(range(12, 14)) == 9).all()


def test_the_firing_rate_is_that_of_the_frames(monkeypatch):
    monkeypatch.setattr("jotlight.view.live.ring._SAMPLE_SECONDS", 0)
    ring = FrameRing(LAYOUT, 2000)
    for index in range(600):
        ring.append(np.full((1, 2, 1), 255 if index >= 300 else 1, np.uint8))
    rates = ring.rates()
    assert 100 < len(rates) <= 512
    np.testing.assert_allclose(rates[:50], 1 / 8)
    np.testing.assert_allclose(rates[-50:], 1)


def test_bits_beyond_the_width_do_not_count_for_the_firing_rate(monkeypatch):
    monkeypatch.setattr("jotlight.view.live.ring._SAMPLE_SECONDS", 0)
    ring = FrameRing(FrameLayout((2, 1), 3, 2, lambda raw: raw.reshape(-1, 2, 1)), 2000)
    for _ in range(600):
        ring.append(np.full((1, 2, 1), 0b00111111, np.uint8))
    np.testing.assert_allclose(ring.rates(), 1 / 3)
