import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.velocity import find_velocity


@pytest.mark.parametrize("velocity", [(0, 0), (1.0, -0.5), (-0.17, 1.9), (0.02, 0.04)])
def test_the_velocity_of_dim_frames_is_found(velocity):
    shifts = np.outer(np.arange(64) - 32, velocity)
    sensor = jl.Sensor(frames=64)
    scene = jl.datasets.moving(None, shifts, sensor=sensor, shape=(128, 128), photons=0.1, rng=0)
    found = find_velocity(scene.bits, 32, 2, None)
    np.testing.assert_allclose(found, velocity, atol=0.06)


def test_bits_without_light_do_not_move():
    bits = jl.Bits.from_array(np.zeros((32, 64, 64), bool))
    assert np.isfinite(find_velocity(bits, 16, 1, None)).all()
