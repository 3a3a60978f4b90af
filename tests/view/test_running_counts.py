"""The running sum of a window that moves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.view.running_counts import RunningCounts
from jotlight.view.timeline import firing_rates
from jotlight.view.viewed import CancelledError, Viewed

BITS = np.random.default_rng(0).random((60, 4, 6)) < 0.4
WINDOWS = st.lists(
    st.tuples(st.integers(0, 59), st.integers(1, 60)).map(
        lambda pair: range(pair[0], min(60, pair[0] + pair[1]))
    ),
    max_size=12,
)


@given(WINDOWS)
def test_the_running_sum_equals_the_sum(spans):
    running = RunningCounts(Viewed.from_data(jl.Bits.from_array(BITS)))
    for span in spans:
        cost, before = running.cost(span), running.counted
        counts = running.move(span)
        np.testing.assert_array_equal(counts, BITS[span.start : span.stop].sum(axis=0))
        assert running.counted - before == cost <= len(span)


def test_counts_of_an_earlier_window_do_not_change():
    running = RunningCounts(Viewed.from_data(jl.Bits.from_array(BITS)))
    first = running.move(range(40))
    running.move(range(1, 41))
    np.testing.assert_array_equal(first, BITS[:40].sum(axis=0))


def test_a_canceled_sum_leaves_the_window_before():
    running = RunningCounts(Viewed.from_data(jl.Bits.from_array(BITS)))
    running.move(range(40))

    def check():
        raise CancelledError

    with pytest.raises(CancelledError):
        running.move(range(5, 45), check)
    np.testing.assert_array_equal(running.move(range(6, 46)), BITS[6:46].sum(axis=0))


def test_images_of_counts_are_summed():
    images = np.arange(24, dtype=np.int32).reshape(4, 2, 3)
    stack = CountStack(images, Provenance("npy", "a.npy"), trials=30)
    viewed = Viewed("a", stack, jl.Sensor(frames=120))
    running = RunningCounts(viewed)
    np.testing.assert_array_equal(running.move(range(1, 4)), images[1:].sum(axis=0))
    assert viewed.sensor(3).frames == 90
    rates, frames = firing_rates(viewed)
    np.testing.assert_allclose(rates, images.mean(axis=(1, 2)) / 30, rtol=1e-6)
    assert frames == 1


@pytest.mark.slow
def test_rates_of_a_long_capture_are_sampled():
    bits = jl.Bits.from_array(np.repeat([[[0]], [[1]]], 1000, axis=0) * np.ones((1, 2, 8), int))
    rates, frames = firing_rates(Viewed.from_data(bits))
    assert len(rates) == 512
    assert frames == 2000 // 512
    assert set(rates[:255]) == {0.0}
    assert set(rates[257:]) == {1.0}
