"""Alignment of moving scenes, against their exact motion."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.align import divide, estimate_motion
from jotlight.motion.blocks import Blocks

pytestmark = pytest.mark.slow


def align(scene):
    bits = jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)
    blocks = Blocks(bits, divide(len(bits)), None, None)
    return estimate_motion(blocks, scene.reference)


def error(motion, scene):
    """Return the root mean square of the errors of the motion at visible points, in pixels."""
    errors = [
        ((motion.at(time) - scene.motion(time)) ** 2).sum(axis=0)[scene.visible(time)]
        for time in range(0, scene.sensor.frames, 10)
    ]
    return np.sqrt(np.concatenate(errors).mean() / 2)


@pytest.mark.parametrize(
    ("motion", "limit"), [("shake", 0.25), ("rotate", 0.25), ("fast", 0.25), ("layers", 3.0)]
)
def test_the_motion_is_found(motion, limit):
    photo = jl.datasets.photograph()
    scene = jl.datasets.moving(
        photo, motion, sensor=jl.Sensor(frames=96), shape=(192, 176), photons=0.3, rng=1
    )
    found = align(scene)
    assert found.model in ("affine", "tiles")
    assert error(found, scene) < limit


def test_a_scene_that_stands_still_has_no_motion():
    scene = jl.datasets.moving(
        motion="static", sensor=jl.Sensor(frames=96), shape=(192, 176), photons=0.3, rng=1
    )
    found = align(scene)
    assert found.model == "none"
    assert abs(found.nodes).max() == 0


@pytest.mark.parametrize("value", [0, 1])
def test_bits_that_are_all_equal_do_not_move(value):
    bits = jl.Bits.from_array(np.full((32, 64, 64), value))
    motion = estimate_motion(Blocks(bits, divide(32), None, None), 16)
    assert motion.model == "none"
