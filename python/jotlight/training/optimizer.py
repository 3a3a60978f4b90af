"""What a training run expects of an optimizer."""

import dataclasses
from typing import Any, Protocol

import numpy.typing as npt

from jotlight.training.cost import Cost
from jotlight.training.parameters import Vector

State = dict[str, npt.NDArray[Any]]
"""What an optimizer keeps from step to step, as arrays that a checkpoint can hold."""


@dataclasses.dataclass(frozen=True)
class Step:
    """The result of one step."""

    vector: Vector
    """Parameters after the step."""
    state: State
    loss: float
    """Cost ε at the start of the step."""
    gradient: Vector
    """∇ε at the start of the step."""


class Optimizer(Protocol):
    """An optimizer for :func:`jotlight.train`. Its `repr` identifies it in a checkpoint."""

    @property
    def steps(self) -> int:
        """Default number of steps."""

    @property
    def pixels(self) -> int:
        """Default number of pixels per step."""

    @property
    def advice(self) -> str:
        """Advice for a run that diverges."""

    def take_step(self, cost: Cost, vector: Vector, state: State) -> Step:
        """Return the next parameters. The state is empty in the first step."""
