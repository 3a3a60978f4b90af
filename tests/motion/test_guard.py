"""The guard: a wrong motion loses against a window without motion, and the true one does not."""

import numpy as np
import pytest

from jotlight.motion.blocks import Sums
from jotlight.motion.guard import count_window, find_window
from moving import blocks_of, paths_of, record


@pytest.fixture(scope="module")
def shake():
    scene, bits = record("shake", photons=0.4)
    blocks = blocks_of(bits)
    shifts = np.stack([scene.motion(time)[:, 0, 0] for time in blocks.centers])
    return bits, blocks, shifts, scene.reference


def total_of(paths):
    return Sums.total([paths.sums(block) for block in range(len(paths.blocks.centers))])


def test_the_true_motion_is_better_than_any_window(shake):
    _, blocks, shifts, reference = shake
    paths = paths_of(blocks, shifts, reference)
    assert find_window(paths, total_of(paths)) is None


def test_a_wrong_motion_is_worse_than_a_window(shake):
    bits, blocks, shifts, reference = shake
    paths = paths_of(blocks, -2 * shifts, reference)
    window = find_window(paths, total_of(paths))
    assert window is not None
    assert window.start <= reference < window.stop
    assert len(window) < len(bits)
    counted = count_window(paths, window)
    expected = bits[window.start : window.stop].counts()
    np.testing.assert_array_equal(counted.ones, expected)
    assert (counted.trials == len(window)).all()
