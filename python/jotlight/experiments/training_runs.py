"""The networks that the experiments train: by jotlight's defaults, and as the paper does."""

from collections.abc import Callable
from typing import Any

from jotlight.datasets.fetch import Progress
from jotlight.experiments.experiment import RunContext
from jotlight.files import delete_file
from jotlight.networks.network import Network
from jotlight.sensing.sensor import Sensor
from jotlight.training import GaussNewton, History, ProjectedGradient, train

Scenes = Any
"""The training images, as :func:`jotlight.training.train` takes them."""


def paper_sensor(bits: int, **options: Any) -> Sensor:
    """Return the paper's sensor: K trials per pixel in a square of jots, one frame, α = K."""
    return Sensor(oversampling=round(bits**0.5), **options)


def train_by_default(
    context: RunContext, name: str, sensor: Sensor, scenes: Scenes, progress: Progress
) -> tuple[Network, History]:
    """Return a network that the default optimizer trained, and its history.

    If `settings["learning_steps"]` is None, the optimizer takes its own number of steps.
    """
    return _train(
        context,
        name,
        Network.initial(sensor),
        scenes,
        progress,
        steps=context.settings["learning_steps"],
        batch=context.settings["learning_batch"],
    )


def train_as_paper(
    context: RunContext, name: str, scenes: Scenes, progress: Progress, bits: int, sigma: float
) -> tuple[Network, History]:
    """Return a network with one weight for each jot, and its history.

    Projected gradient descent, equation (13), trains the network.
    """
    settings = context.settings
    return _train(
        context,
        name,
        Network.initial(paper_sensor(bits), sigma=sigma, tied=False),
        scenes,
        progress,
        steps=settings["steps"],
        batch=settings["batch"],
        patch=None if callable(scenes) else 32,
        optimizer=ProjectedGradient(settings["learning_rate"]),
    )


def _train(
    context: RunContext,
    name: str,
    start: Network,
    scenes: Scenes,
    progress: Progress,
    **options: Any,
) -> tuple[Network, History]:
    """Return a trained network and its history.

    The run resumes from the checkpoint that an interrupted run left.
    """
    checkpoint = context.folder / f"{name}.checkpoint.safetensors"
    result = train(
        start,
        scenes,
        rng=context.settings["seed"],
        checkpoint=checkpoint,
        resume=checkpoint.exists(),
        callback=_report_steps(progress, options["steps"]),
        threads=context.threads,
        **options,
    )
    delete_file(checkpoint)
    return result


def _report_steps(progress: Progress, steps: int | None) -> Callable[[Any], object]:
    total = steps or GaussNewton.steps
    return lambda record: progress(record.step / total)
