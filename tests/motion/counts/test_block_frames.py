"""The frames of blocks that are counted."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.burst import as_burst


@pytest.mark.parametrize(
    ("probability", "size", "step"),
    [(0.2, 256, 1), (0.5, 256, 2), (0.8, 256, 1), (0.5, 64, 1)],
)
def test_bright_blocks_need_a_part_of_their_frames(probability, size, step):
    """A large image needs 1.5 ones or zeros per pixel, whichever are rarer."""
    bits = np.random.default_rng(0).random((64, size, size)) < probability
    blocks = Blocks(as_burst(jl.Bits.from_array(bits)), np.arange(0, 65, 8))
    few = blocks.with_enough_light()
    assert few.step == step
    assert {len(few.frames(block)) for block in range(8)} == {8 // step}


def test_the_light_is_measured_on_as_many_threads_as_all_else(monkeypatch):
    """The first call of a thread decides how many threads work with it."""
    numbers = []

    def counts(self, oversampling, threads):
        numbers.append(threads)
        return np.full((16, 20), 8)

    monkeypatch.setattr(jl.Bits, "counts", counts)
    burst = as_burst(jl.Bits.from_array(np.zeros((64, 16, 20), bool)))
    assert Blocks(burst, np.array([0, 64]), threads=3).mean_count == 8 / 32
    assert numbers == [3]


def test_every_second_frame_of_a_block_is_counted():
    bits = np.random.default_rng(1).random((12, 16, 20)) < 0.4
    burst = as_burst(jl.Bits.from_array(bits))
    blocks = Blocks(burst, np.array([0, 5, 12]), step=2)
    assert [list(blocks.frames(block)) for block in (0, 1)] == [[0, 2, 4], [5, 7, 9, 11]]
    still = np.zeros((2, 2, 1, 2))
    sums = blocks.count(blocks.frames(1), still, [5.0, 12.0])
    np.testing.assert_array_equal(sums.ones, bits[5:12:2].sum(axis=0))
    np.testing.assert_array_equal(sums.trials, 4)
