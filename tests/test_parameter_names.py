"""Names of parameters in other libraries."""

import importlib
import inspect

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets.scenes import uniform_scene

IMAGE = np.full((4, 6), 0.5)
SENSOR = jl.Sensor(frames=2)
NETWORK = jl.Network.initial(SENSOR)

CALLS = {
    "expose": lambda **seed: SENSOR.expose(IMAGE, **seed),
    "moving": lambda **seed: jl.datasets.moving(sensor=SENSOR, **seed),
    "uniform_scene": uniform_scene,
    "draw": lambda **seed: jl.FreeRunning(dead_time=0.01).draw(IMAGE, **seed),
    "compare": lambda **seed: jl.compare("mle", IMAGE, SENSOR, **seed),
    "evaluate": lambda **seed: jl.evaluate("mle", [IMAGE], SENSOR, **seed),
    "train": lambda **seed: jl.train(NETWORK, [IMAGE], **seed),
    "residual": lambda **seed: jl.Network.residual(SENSOR, **seed),
    "conditional": jl.Network.conditional,
    "initial": jl.FilmNetwork.initial,
}


@pytest.mark.parametrize("name", ["seed", "random_state"])
@pytest.mark.parametrize("call", CALLS)
def test_another_name_of_a_seed_gets_the_name_here(call, name):
    message = f"{call}: expected rng= for a seed or a random generator, got {name}=; write rng="
    with pytest.raises(TypeError, match=message):
        CALLS[call](**{name: 1})


@pytest.mark.parametrize(("module", "call"), [("training", "train"), ("fine_tuning", "fine_tune")])
def test_trainings_with_pytorch_have_the_same_message(module, call):
    pytest.importorskip("torch")
    train = getattr(importlib.import_module(f"jotlight.torch.{module}"), call)
    with pytest.raises(TypeError, match=f"{call}: expected rng= for a seed"):
        train(NETWORK, [IMAGE], seed=1)


def test_signatures_and_other_errors_stay():
    assert list(inspect.signature(jl.Sensor.expose).parameters)[:3] == ["self", "image", "rng"]
    with pytest.raises(TypeError, match="unexpected keyword argument 'tiles'"):
        SENSOR.expose(IMAGE, tiles=3)
