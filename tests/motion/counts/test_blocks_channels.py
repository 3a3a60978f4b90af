"""Counts along a motion of stacks of counts, and of color channels."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.burst import as_burst
from jotlight.sensing.parameters.provenance import Provenance
from moving import blocks_of
from reference.motion import shifted_counts


@pytest.mark.parametrize("channels", [None, 3])
def test_counts_and_colors_have_the_sums_of_their_binary_readings(channels):
    """A count of n out of 255 is a pixel of 255 binary frames with n ones."""
    rng = np.random.default_rng(9)
    shape = (3, 20, 40) if channels is None else (3, 20, 40, channels)
    counts = rng.integers(0, 256, shape, np.uint8)
    valid = rng.random((20, 40)) < 0.8
    blocks = Blocks(
        as_burst(CountStack(counts, Provenance("npy", "a"), 255)),
        np.array([0, 3]),
        np.packbits(valid, axis=1),
    )
    field = rng.normal(0, 3, (2, 2, 3)).astype(np.float32)
    found = blocks.count(range(3), (field, field), (0, 3))
    ones, trials, remainders = np.zeros((20, 40)), np.zeros((20, 40)), 0
    for image in counts.reshape(3, 20, 40, -1).transpose(0, 3, 1, 2).reshape(-1, 20, 40):
        readings = np.arange(255)[:, None, None] < image
        expected = shifted_counts(readings, field, field, 16, np.zeros(255), valid)
        ones, trials = ones + expected[0], trials + expected[1]
        remainders = remainders + expected[2] / 255
    np.testing.assert_array_equal(found.ones, ones)
    np.testing.assert_array_equal(found.trials, trials)
    np.testing.assert_allclose(found.remainders, remainders / (channels or 1), atol=1e-3)
    assert blocks.trials == 255 * (channels or 1)


def test_a_channel_can_be_counted_alone():
    rng = np.random.default_rng(10)
    color = rng.random((5, 16, 24, 3)) < 0.4
    field = np.full((2, 1, 2), 1.2, np.float32)
    for channel in range(3):
        blocks = Blocks(as_burst(jl.Bits.from_array(color)), np.array([0, 5]), channel=channel)
        expected = blocks_of(jl.Bits.from_array(color[..., channel]), 1)
        for name in ("ones", "trials", "remainders"):
            np.testing.assert_array_equal(
                getattr(blocks.count(range(5), (field, field), (0, 5)), name),
                getattr(expected.count(range(5), (field, field), (0, 5)), name),
            )
