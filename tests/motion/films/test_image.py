"""Which blocks of a window the film network reads besides the whole window."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.films.film import film
from jotlight.motion.films.image import find_parts


def parts_of(frames, blocks, reference):
    edges = np.linspace(0, frames, blocks + 1).round().astype(int)
    centers = (edges[:-1] + edges[1:] - 1) / 2
    blocks = SimpleNamespace(centers=centers, is_lit=np.ones(len(centers), bool))
    paths = SimpleNamespace(blocks=blocks, reference=reference)
    return [sorted(part) for part in find_parts(paths)]


@pytest.mark.parametrize(
    ("blocks", "reference", "expected"),
    [
        (32, 127.5, [range(12, 20), [15, 16], [13, 14], [17, 18], [11, 12], [19, 20]]),
        (32, 128, [range(12, 20), [15, 16], [17, 18], [13, 14], [19, 20], [11, 12]]),
        (32, 255, [range(24, 32), [30, 31], [28, 29], [26, 27], [24, 25], [22, 23]]),
        (32, 10, [range(8), [0, 1], [2, 3], [4, 5], [6, 7], [8, 9]]),
        (16, 128, [range(6, 10), [8], [7], [9], [6], [10]]),
    ],
)
def test_the_parts_next_to_the_nearest_one_follow_in_time(blocks, reference, expected):
    assert parts_of(256, blocks, reference) == [list(part) for part in expected]


def test_of_two_parts_with_the_same_distance_the_earlier_one_is_first():
    # The three blocks around the reference time are the nearest part.
    found = parts_of(480, 48, 244.5)
    assert found[1:] == [[23, 24, 25], [20, 21, 22], [26, 27, 28], [17, 18, 19], [29, 30, 31]]


def test_short_windows_have_fewer_parts():
    assert parts_of(4, 4, 3) == [[3], [3], [2], [1], [0], []]
    assert parts_of(1, 1, 0) == [[0], [0], [], [], [], []]


@pytest.mark.parametrize("blocks", [1, 5, 16, 33, 64, 100])
@pytest.mark.parametrize("place", [0.0, 0.2, 0.5, 0.93, 1.0])
def test_parts_do_not_overlap_and_are_next_to_each_other(blocks, place):
    _, *sixteenths = parts_of(8 * blocks, blocks, place * (8 * blocks - 1))
    together = sorted(block for part in sixteenths for block in part)
    assert len(together) == len(set(together))
    assert together == list(range(together[0], together[-1] + 1))


def test_an_image_is_pickled_with_its_counts_and_without_the_frames():
    bits = jl.Sensor(frames=64).expose(np.full((64, 64), 0.3), rng=0)
    image = next(film(bits, window=32))
    data = pickle.dumps(image)
    other = pickle.loads(data)
    assert len(other.nearest) == len(image.nearest) == 6
    for own, expected in zip(other.nearest, image.nearest, strict=True):
        np.testing.assert_array_equal(own.ones, expected.ones)
    assert other.time == image.time
    np.testing.assert_array_equal(other.merged.ones, image.merged.ones)
