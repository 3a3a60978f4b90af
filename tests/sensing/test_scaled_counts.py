"""Counts of images that hold the means of frames, times a scale."""

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from jotlight.datasets import photograph
from jotlight.sensing.scaled_counts import recognize_trials, scaled_counts_hint, unscale_counts


@pytest.mark.parametrize("rounding", [np.rint, np.floor, lambda x: np.floor(x + 0.5)])
@pytest.mark.parametrize("scale", [255, 65535, 1000])
def test_all_counts_are_found_for_all_numbers_of_trials(rounding, scale):
    for trials in range(1, min(1000, int(scale / 1.5)) + 1):
        counts = np.arange(trials + 1)
        values = rounding(counts * scale / trials).astype(np.int64)
        np.testing.assert_array_equal(unscale_counts(values, scale, trials), counts)


@pytest.mark.parametrize("trials", [3, 4, 16, 64, 127])
def test_the_number_of_trials_is_recognized(trials):
    counts = random_frames((trials, 40, 50), share=0.3).sum(0)
    for scale in (255, 65535):
        values = np.rint(counts * scale / trials).astype(np.int64)
        assert recognize_trials(values, scale) == trials
        assert f"trials={trials} (--frames {trials})" in scaled_counts_hint(values)


@pytest.mark.parametrize(
    "values",
    [
        np.arange(20),
        random_frames((30, 20, 20)).sum(0),
        np.rint(255 * photograph("camera")).astype(int),
        np.array([0, 255]),
        np.array([-255, 0, 64, 128]),
        np.array([0, 100, 70000]),
    ],
)
def test_counts_photographs_and_bits_have_no_scale(values):
    assert scaled_counts_hint(values) is None


@pytest.mark.parametrize("values", [[-16, 16], [0, 17, 32], [0, 271], [1, 2, 3]])
def test_other_values_are_refused(values):
    with pytest.raises(ValueError, match=r"counts_scale: expected (multiples of 255 / 16|values)"):
        unscale_counts(np.array(values), 255, 16)


def test_methods_propose_the_scale_of_scaled_counts():
    values = np.array([[0, 16, 64, 255]])
    with pytest.raises(ValueError, match=r"0 to K = 16 .*counts_scale=255 .* and trials=16"):
        jl.mle(values, jl.Sensor(frames=16))
