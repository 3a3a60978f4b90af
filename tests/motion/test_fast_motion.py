"""Motion within blocks: its size, and no false alarms."""

import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.errors import JotlightWarning
from jotlight.motion.align import prepare_burst
from jotlight.motion.counts.block_edges import block_edges
from jotlight.motion.counts.sensor_blocks import as_blocks
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.fast_motion import find_fast_motion
from moving import moved, record


def still_paths(bits):
    """Return the paths of a scene that is taken to stand still."""
    burst, sensor = prepare_burst(bits, None)
    blocks = as_blocks(burst, block_edges(len(burst)), sensor, None)
    return Paths([Track.still(blocks)], np.zeros(blocks.size, np.uint8))


def vibration(frames, period, length):
    """Return shifts of a sinusoidal vibration along the rows."""
    return np.outer(length * np.sin(2 * np.pi * np.arange(frames) / period), (1.0, 0.0))


@pytest.mark.parametrize(
    ("shifts", "deviation"),
    [
        (vibration(64, 3.3, 3.0), 3 / 2),
        (np.random.default_rng(0).normal(0, 1.5, (64, 2)), 1.5),
        (np.zeros((64, 2)), 0.0),
        (vibration(64, 3.3, 0.3), 0.0),
    ],
)
def test_the_standard_deviation_of_motion_within_blocks_is_found(shifts, deviation):
    bits = moved(shifts, shape=(64, 64), photons=0.5, rng=1)[1]
    assert find_fast_motion(still_paths(bits), None) == pytest.approx(deviation, rel=0.4)


def test_dark_parts_of_blocks_say_nothing_about_motion():
    array = moved(np.zeros((64, 2)), shape=(64, 64), photons=0.5, rng=1)[1].to_array().copy()
    array[::3] = 0
    assert find_fast_motion(still_paths(jl.Bits.from_array(array)), None) == 0.0


@pytest.mark.slow
def test_slower_motion_within_long_blocks_is_found():
    bits = moved(vibration(1024, 40, 3.0), shape=(64, 64), photons=0.1, rng=1)[1]
    assert find_fast_motion(still_paths(bits), None) == pytest.approx(1.5, rel=0.5)


@pytest.mark.slow
def test_a_vibrating_scene_is_reported():
    bits = moved(vibration(64, 3.3, 3.0), shape=(64, 64), photons=0.5, rng=1)[1]
    with pytest.warns(JotlightWarning, match=r"moves by about 1\.\d pixels .* within 4 frames"):
        jl.align(bits)


@pytest.mark.slow
@pytest.mark.parametrize("photons", [0.05, 0.7])
@pytest.mark.parametrize(
    "motion", ["static", "shake", "rotate", "fast", "layers", "person", "sheet", "spin", "flicker"]
)
def test_smooth_motions_are_not_reported(motion, photons):
    _, bits = record(motion, frames=48, shape=(64, 96), photons=photons)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        jl.align(bits)
    assert not [each for each in found if "within" in str(each.message)]
