"""Pixels whose only bit is hidden from the network."""

import numpy as np
import pytest
from scipy import stats

pytest.importorskip("torch")

from jotlight.torch.blind_spots import FRACTION, draw_blind_spots, fill_blind_spots

RNG = np.random.default_rng(0)


def test_a_tenth_of_the_known_pixels_is_hidden():
    known = RNG.random((300, 300)) < 0.7
    hidden = draw_blind_spots(RNG, known)
    assert not (hidden & ~known).any()
    assert stats.binomtest(int(hidden.sum()), int(known.sum()), FRACTION).pvalue > 1e-9


def test_known_bits_stay_and_unknown_ones_come_from_near_pixels():
    known = RNG.random((60, 70)) < 0.8
    # Each pixel has its own number, which shows where a value comes from.
    numbers = np.arange(60 * 70).reshape(60, 70)
    filled = fill_blind_spots(RNG, numbers, known)
    np.testing.assert_array_equal(filled[known], numbers[known])
    assert known.flat[filled].all()
    rows, columns = np.divmod(filled, 70)
    distance = np.maximum(abs(rows - np.mgrid[:60, :70][0]), abs(columns - np.mgrid[:60, :70][1]))
    assert distance.max() == 2


def test_hidden_bits_do_not_show_in_the_input():
    bits = (RNG.random((400, 400)) < 0.5).astype(int)
    hidden = draw_blind_spots(RNG, np.ones(bits.shape, bool))
    filled = fill_blind_spots(RNG, bits, ~hidden)
    same = int((filled == bits)[hidden].sum())
    assert stats.binomtest(same, int(hidden.sum()), 0.5).pvalue > 1e-9


def test_large_holes_get_the_nearest_bits():
    known = np.zeros((40, 40), bool)
    known[:, 0] = True
    assert (fill_blind_spots(RNG, known.astype(int), known) == 1).all()
    nothing = np.zeros((3, 3), int)
    np.testing.assert_array_equal(fill_blind_spots(RNG, nothing, nothing > 0), nothing)
