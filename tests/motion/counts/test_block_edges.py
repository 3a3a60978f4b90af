"""How frames are divided into blocks."""

import numpy as np
import pytest

from jotlight.motion.counts.block_edges import block_edges, window_edges


@pytest.mark.parametrize("frames", [1, 2, 15, 16, 17, 31, 64, 200, 999, 1024, 1025, 50_000])
def test_blocks_cover_all_frames_once_and_have_similar_lengths(frames):
    edges = block_edges(frames)
    lengths = np.diff(edges)
    assert edges[0] == 0
    assert edges[-1] == frames
    assert lengths.min() >= 1
    assert lengths.max() - lengths.min() <= 1
    assert len(lengths) <= frames
    if frames >= 16:
        assert len(lengths) >= 16


@pytest.mark.parametrize("frames", [32, 48, 96, 100, 256, 1000, 4096])
def test_blocks_are_the_same_in_reversed_time(frames):
    edges = block_edges(frames)
    np.testing.assert_array_equal(edges, frames - edges[::-1])


def test_many_frames_have_more_and_longer_blocks():
    edges = [block_edges(frames) for frames in (1024, 4096, 16384)]
    lengths, numbers = [np.diff(each).mean() for each in edges], [len(each) for each in edges]
    assert lengths[2] / lengths[0] == pytest.approx(4, rel=0.05)
    assert numbers[2] / numbers[0] == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("frames", [16, 63, 64, 100, 256, 1000])
@pytest.mark.parametrize("step", [1, 3, 8, 16, 25, 32])
def test_blocks_are_shared_by_windows(frames, step):
    edges = window_edges(frames, step)
    lengths = np.diff(edges)
    usual = frames / (len(block_edges(frames)) - 1)
    assert edges[0] == 0
    assert edges[-1] == frames
    assert lengths.min() >= 1
    assert lengths.max() <= max(2 * usual + 1, 24)
    if step >= usual:
        # The last block is longer or shorter, so that all frames lie in one.
        shared = edges[(edges >= step) & (edges < frames)] - step
        assert set(shared) <= set(edges.tolist())
