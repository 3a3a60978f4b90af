"""Two captures that do not fit together are reported, and others are not."""

import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.calibration.agreement import dark_count_conflict
from jotlight.calibration.jot_counts import JotCounts

SHAPE = (96, 96)
WARNING = "do not have the dark counts"


def dark_counts(seed=0, hot=0.01):
    """Return dark counts of a sensor with hot jots."""
    rng = np.random.default_rng(seed)
    dark = rng.gamma(4, 0.0005, SHAPE)
    is_hot = rng.random(SHAPE) < hot
    return np.where(is_hot, rng.uniform(0.2, 8, SHAPE), dark)


def draw(rates, frames, seed):
    return np.random.default_rng(seed).binomial(frames, -np.expm1(-rates))


def calibrate(dark, flat, frames=1000, flat_frames=1000, **options):
    return jl.calibrate(dark, flat, frames=frames, flat_frames=flat_frames, **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("light", "flat_frames"),
    [
        (0.7, 2),
        (0.7, 10),
        (2.0, 10),
        (0.05, 1000),
        (2.0, 1000),
    ],
)
def test_captures_of_one_sensor_fit_together(light, flat_frames):
    dark = dark_counts()
    response = 1 + 0.1 * np.random.default_rng(3).standard_normal(SHAPE)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=f".*{WARNING}")
        for seed in range(5):
            flat = draw(dark + light * response, flat_frames, 2 * seed + 1)
            calibrate(draw(dark, 1000, 2 * seed), flat, flat_frames=flat_frames)


@pytest.mark.parametrize(
    "change",
    [
        lambda dark: dark_counts(seed=1),  # another sensor
        lambda dark: dark[::-1],
        lambda dark: dark / 4,  # a shorter exposure
    ],
)
def test_dark_counts_of_another_capture_are_reported(change):
    dark = dark_counts()
    flat = draw(change(dark) + 0.7, 1000, 1)
    with pytest.warns(jl.JotlightWarning, match=WARNING):
        calibrate(draw(dark, 1000, 0), flat)


def test_a_wrong_number_of_flat_frames_is_reported():
    dark = dark_counts()
    flat = draw(dark + 0.7, 250, 1)
    with pytest.warns(jl.JotlightWarning, match=r"check the numbers of frames .*--flat-frames"):
        calibrate(draw(dark, 1000, 0), flat, flat_frames=1000)


def test_few_hot_jots_are_no_evidence():
    dark = np.full(SHAPE, 0.002)
    dark[::40, ::40] = 0.5
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=f".*{WARNING}")
        calibrate(draw(dark, 1000, 0), draw(np.full(SHAPE, 0.7), 1000, 1))


@pytest.mark.parametrize("frames", [1, 16, 256])
@pytest.mark.parametrize("light", [0.02, 0.2])
def test_a_scene_shows_whether_the_dark_counts_are_those_of_its_sensor(light, frames):
    dark = dark_counts(hot=0.03)
    scene = light * jl.datasets.photograph("camera")[200:296, 200:296]
    own = draw(scene + dark, frames, 0)
    assert dark_count_conflict(JotCounts(own, frames, 1), dark) is None
    shorter = draw(scene + dark / 20, frames, 0)
    for ones, stated in (
        (own, dark_counts(seed=1, hot=0.03)),
        (own, dark[:, ::-1]),
        (shorter, dark),
    ):
        missing, number = dark_count_conflict(JotCounts(ones, frames, 1), stated)
        assert number / 2 < missing <= number


def test_dark_counts_without_hot_jots_do_not_contradict_a_scene():
    ones = np.zeros(SHAPE, np.int32)
    for dark in (0.3, np.full(SHAPE, 0.3), np.zeros(SHAPE)):
        assert dark_count_conflict(JotCounts(ones, 16, 1), dark) is None
