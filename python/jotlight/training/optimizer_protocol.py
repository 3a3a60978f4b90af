"""The interface between a training run and its optimizer."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.training.cost import Cost

State = dict[str, npt.NDArray[Any]]
"""Arrays that an optimizer keeps from step to step. Checkpoints store them."""


@dataclasses.dataclass(frozen=True)
class Step:
    """The result of one step.

    Parameters
    ----------
    vector : ndarray of float64
        Parameters after the step.
    state : State
        State of the optimizer after the step.
    loss : float
        Cost ε at the start of the step.
    gradient : ndarray of float64
        ∇ε at the start of the step.
    """

    vector: Array
    state: State
    loss: float
    gradient: Array


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
        """Advice in the message about a run that diverges."""

    def take_step(self, cost: Cost, vector: Array, state: State) -> Step:
        """Return the result of the next step. The state is empty in the first step."""
