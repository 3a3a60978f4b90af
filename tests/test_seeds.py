"""Seeds: one rule for all functions."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets.scenes import uniform_scene

CALLS = {
    "expose": lambda rng: jl.Sensor().expose([[0.5]], rng),
    "moving": lambda rng: jl.datasets.moving(
        motion="shake", sensor=jl.Sensor(frames=4), shape=(32, 32), rng=rng
    ),
    "uniform_scene": lambda rng: uniform_scene((4, 4), rng),
    "check_adjoint": lambda rng: jl.operators.check_adjoint(jl.operators.spread((4,)), rng=rng),
    "draw": lambda rng: jl.FreeRunning(dead_time=0.01).draw([1.0], rng),
    "initial": lambda rng: jl.Network.residual(jl.Sensor(), rng=rng),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_seeds_are_whole_numbers(call):
    for wrong in (True, "0", 0.5):
        with pytest.raises(TypeError, match=r"rng: expected a whole number, a numpy\.random\.Gen"):
            call(wrong)
    with pytest.raises(ValueError, match="rng: expected a seed of 0 or more, got -1"):
        call(-1)
    call(np.int64(3))
