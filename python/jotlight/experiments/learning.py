"""What experiments learn with: the recipe of :func:`jotlight.train`, and the paper's descent."""

from collections.abc import Callable
from typing import Any

import jotlight as jl
from jotlight.experiments.experiment import Lab, Update
from jotlight.training import History, ProjectedGradient

Scenes = Any
"""What :func:`jotlight.train` learns from."""


def sensor_of(bits: int, **options: Any) -> jl.Sensor:
    """The paper's sensor: K bits in a square of jots, one frame, α = K."""
    return jl.Sensor(oversampling=round(bits**0.5), **options)


def learn(
    lab: Lab, name: str, sensor: jl.Sensor, scenes: Scenes, update: Update
) -> tuple[jl.Network, History]:
    """Learn by the default recipe; `settings["learning_steps"]` None is its own number."""
    steps = lab.settings["learning_steps"]
    start = jl.Network.initial(sensor)
    return _resumable(
        lab, name, start, scenes, update, steps=steps, batch=lab.settings["learning_batch"]
    )


def descend(
    lab: Lab, name: str, scenes: Scenes, update: Update, bits: int, sigma: float
) -> tuple[jl.Network, History]:
    """Learn as the paper did: projected gradients, and a weight for each jot."""
    settings = lab.settings
    start = jl.Network.initial(sensor_of(bits), sigma=sigma, tied=False)
    return _resumable(
        lab,
        name,
        start,
        scenes,
        update,
        steps=settings["steps"],
        batch=settings["batch"],
        patch=None if callable(scenes) else 32,
        optimizer=ProjectedGradient(settings["learning_rate"]),
    )


def _resumable(
    lab: Lab, name: str, start: jl.Network, scenes: Scenes, update: Update, **options: Any
) -> tuple[jl.Network, History]:
    checkpoint = lab.folder / f"{name}.checkpoint.safetensors"
    result = jl.train(
        start,
        scenes,
        rng=lab.settings["seed"],
        checkpoint=checkpoint,
        resume=checkpoint.exists(),
        callback=_telling(update, options["steps"]),
        threads=lab.threads,
        **options,
    )
    checkpoint.unlink()
    return result


def _telling(update: Update, steps: int | None) -> Callable[[Any], object]:
    total = steps or jl.training.GaussNewton.steps
    return lambda record: update(record.step / total)
