"""Frames that are stored in blocks."""

import itertools
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from jotlight.formats.frames.blocks import read_by_blocks
from jotlight.sensing.bits.frames import Frames

ARRAY = np.arange(11 * 2 * 3, dtype=np.uint16).reshape(11, 2, 3)


def recorded(length, max_bytes=None):
    """Return frames in blocks, and the list of the parts that are read of their file."""
    parts = []

    def read(start, stop):
        parts.append((start, stop))
        return ARRAY[start:stop].copy()

    return read_by_blocks(Frames(ARRAY.shape, read, ARRAY.dtype), length, max_bytes), parts


@pytest.mark.parametrize("length", [1, 2, 4, 11, 20])
def test_every_part_is_the_same_as_without_blocks(length):
    frames = recorded(length)[0]
    for start, stop in itertools.combinations_with_replacement(range(12), 2):
        part = frames.read(start, stop)
        np.testing.assert_array_equal(part, ARRAY[start:stop])
        part[...] = 0  # must not change what is read next


@pytest.mark.parametrize("length", [1, 2, 4, 11, 20])
@pytest.mark.parametrize("step", [1, 3, 5, 11])
def test_each_frame_is_read_once_in_complete_blocks_when_read_in_order(length, step):
    frames, parts = recorded(length)
    for start in range(0, 11, step):
        frames.read(start, min(start + step, 11))
    assert [frame for part in parts for frame in range(*part)] == list(range(11))
    assert all(end % length == 0 or end == 11 for part in parts for end in part)


def test_large_blocks_are_divided():
    frames, parts = recorded(8, max_bytes=36)  # three frames
    for start in range(8):
        frames.read(start, start + 1)
    assert parts == [(0, 3), (3, 6), (6, 9)]


def test_threads_read_parts_independently():
    def read(start, stop):
        time.sleep(0.0005)  # so that other threads read meanwhile
        return ARRAY[start:stop].copy()

    frames = read_by_blocks(Frames(ARRAY.shape, read, ARRAY.dtype), 4)
    parts = list(itertools.combinations(range(12), 2)) * 4
    with ThreadPoolExecutor(4) as threads:
        results = threads.map(lambda part: frames.read(*part), parts)
        for (start, stop), part in zip(parts, results, strict=True):
            np.testing.assert_array_equal(part, ARRAY[start:stop])
