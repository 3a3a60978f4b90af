"""The frames of a film that are known."""

import numpy as np

import jotlight as jl
from jotlight.motion.films.frames import FilmFrames


def test_frames_are_found_by_their_numbers():
    frames = np.random.default_rng(0).random((20, 8, 16)) < 0.5
    known = FilmFrames(jl.Bits.from_array(frames[5:]), first=5)
    assert known.numbers == range(5, 20)
    np.testing.assert_array_equal(known.part(range(7, 12)).to_array(), frames[7:12])
    np.testing.assert_array_equal(known.part(known.numbers).to_array(), frames[5:])
