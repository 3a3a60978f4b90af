"""The cost of aligning and merging: its growth, and its memory against a measurement."""

import tracemalloc

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.cost import motion_cost


def test_the_cost_grows_with_frames_and_pixels():
    small, large = motion_cost(100, (128, 256)), motion_cost(100, (256, 256))
    assert large.memory == pytest.approx(2 * small.memory)
    for name in ("seconds", "further_seconds"):
        assert 1 < getattr(large, name) / getattr(small, name) < 2
    costs = [motion_cost(frames, (256, 256)) for frames in (16, 256, 1024, 4096, 10**6)]
    assert all(np.diff([cost.seconds for cost in costs]) > 0)
    assert all(cost.further_seconds < cost.seconds / 3 for cost in costs)
    assert costs[0].memory < costs[2].memory < costs[3].memory
    # The sums of many blocks are not kept.
    assert motion_cost(10**6, (256, 512)).memory < 300e6


@pytest.mark.slow
def test_the_memory_is_that_of_numpy():
    scene = jl.datasets.moving(
        motion="shake", sensor=jl.Sensor(frames=256), shape=(96, 128), photons=0.3, rng=0
    )
    bits = jl.Bits(np.asarray(scene.bits.packed), scene.bits.width)
    jl.merge(bits[:16])  # loads networks
    tracemalloc.start()
    jl.merge(bits, threads=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.5 < motion_cost(256, (96, 128)).memory / peak < 2


@pytest.mark.parametrize(("frames", "size"), [(0, (8, 8)), (1, (0, 8)), (1, (8, -1))])
def test_numbers_below_one_are_refused(frames, size):
    with pytest.raises(ValueError, match="expected 1 frame or more"):
        motion_cost(frames, size)
