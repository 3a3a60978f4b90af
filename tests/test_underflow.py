"""Tiny probabilities are 0, also if the caller makes NumPy raise errors."""

import numpy as np
import pytest

import jotlight as jl

BRACKET = jl.Sensor(frames=8, gain=[1.0, 64.0] * 4)


def find_hot_jots_of_a_dark_capture():
    counts = np.random.default_rng(0).binomial(4096, 0.002, (64, 64))
    counts[10, 20] = 4096
    assert jl.calibrate(counts, frames=4096).mask[10, 20]


def merge_counts_of_dead_times():
    jl.FreeRunning(dead_time=0.01).merge([[0, 20, 50, 100]], light=200.0)


def plan_with_read_noise():
    jl.plan(jl.Sensor(bit_depth=4, read_noise=0.3), (0.05, 1.0), frames=[16])


def find_intervals_of_a_bracket():
    bits = BRACKET.expose(np.linspace(0, 1, 64).reshape(8, 8), rng=0)
    jl.uncertainty(bits, method="mle")


@pytest.mark.parametrize(
    "run",
    [
        find_hot_jots_of_a_dark_capture,
        merge_counts_of_dead_times,
        plan_with_read_noise,
        find_intervals_of_a_bracket,
    ],
)
def test_errors_of_numpy_do_not_stop_a_call(run):
    with np.errstate(all="raise"):
        run()
