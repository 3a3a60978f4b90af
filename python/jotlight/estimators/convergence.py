"""How an iterative method tells where it stands, and when it is done."""

import dataclasses
import math
import operator
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn


@dataclasses.dataclass(frozen=True)
class Iteration:
    """Where an iterative method stands."""

    number: int
    """From 1 on."""
    residuals: Mapping[str, float]
    """By name."""
    residual: float
    """The largest of them, in the measure in which the method is done when it is at most `tol`."""
    estimate: npt.NDArray[np.float64]
    """The estimate so far, read-only."""
    tol: float
    max_iter: int

    @property
    def progress(self) -> float:
        """How much is done, from 0 to 1: residuals fall by about the same factor each time."""
        if self.residual <= self.tol or self.tol >= 1:
            return 1.0
        return min(max(math.log(self.residual) / math.log(self.tol), 0.0), 1.0)


Callback = Callable[[Iteration], object]
"""Called after every iteration; it ends the run by raising StopIteration."""


@dataclasses.dataclass(frozen=True)
class ConvergenceHistory:
    """How an iterative method came to its picture."""

    converged: bool
    """Whether the residuals came below `tol`."""
    residuals: dict[str, npt.NDArray[np.float64]]
    """By name, one number for each iteration."""
    objective: float
    """What was minimised, -ℓ and the method's prior, at the picture in float64."""
    weight: float | npt.NDArray[np.floating] = 0.0
    """Of the prior, a number or one for each pixel."""

    @property
    def iterations(self) -> int:
        """How many there were."""
        return len(next(iter(self.residuals.values())))


class ConvergenceMonitor:
    """Collects the residuals, calls the user back, and says when to stop."""

    def __init__(self, name: str, max_iter: int, tol: float, callback: Callback | None) -> None:
        if not isinstance(tol, float | int | np.number) or not 0 < tol < np.inf:
            raise ValueError(f"tol: expected a finite number above 0, got {tol!r}")
        try:
            self.max_iter = operator.index(max_iter)
        except TypeError:
            raise TypeError(f"max_iter: expected a whole number, got {max_iter!r}") from None
        if self.max_iter < 1:
            raise ValueError(f"max_iter: expected 1 or more, got {max_iter}")
        self.tol = float(tol)
        self._name = name
        self._callback = callback
        self._residuals: list[Mapping[str, float]] = []
        self._ended = False
        self._worst = math.inf
        self._remedy = "raise max_iter, or tol"
        self.converged = False

    @property
    def number(self) -> int:
        """Iterations so far."""
        return len(self._residuals)

    def update(
        self,
        image: npt.NDArray[np.float64],
        residuals: Mapping[str, float],
        leeway: Mapping[str, float] | None = None,
    ) -> bool:
        """Take note of an iteration and tell whether there is to be another.

        `leeway` says how many `tol` some of the residuals may have.
        """
        self._residuals.append(residuals)
        worst = max(value / (leeway or {}).get(name, 1.0) for name, value in residuals.items())
        step = Iteration(self.number, residuals, worst, _readonly(image), self.tol, self.max_iter)
        self._worst = worst
        self.converged = worst <= self.tol
        if self._callback is not None:
            try:
                self._callback(step)
            except StopIteration:
                self._ended = True
        return not (self.converged or self._ended or step.number >= self.max_iter)

    def give_up(self, reason: str) -> None:
        """Say why there cannot be another iteration."""
        self._remedy = reason

    def finish(
        self, objective: float, weight: float | npt.NDArray[np.floating] = 0.0
    ) -> ConvergenceHistory:
        """Sum up, and warn when the method is not done; who ended it himself knows."""
        names = self._residuals[0]
        residuals = {
            name: np.array([step[name] for step in self._residuals], np.float64) for name in names
        }
        if not (self.converged or self._ended):
            last = ", ".join(f"{name} {values[-1]:.2g}" for name, values in residuals.items())
            plural = "" if self.number == 1 else "s"
            warn(
                f"{self._name}: not converged after {self.number} iteration{plural}: residual "
                f"{self._worst:.2g} ({last}), expected at most tol = {self.tol:g}; {self._remedy}"
            )
        return ConvergenceHistory(self.converged, residuals, objective, weight)


def _readonly(image: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    view = image.view()
    view.flags.writeable = False
    return view
