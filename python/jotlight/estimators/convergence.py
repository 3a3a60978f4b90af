"""Progress and convergence of the iterative methods: callbacks, the stopping rule, the history."""

import dataclasses
import math
import operator
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.estimators.figure import draw_residuals

if TYPE_CHECKING:
    from jotlight.figures import Figure


@dataclasses.dataclass(frozen=True)
class Iteration:
    """The state of an iterative method after one iteration, as a callback receives it."""

    number: int
    """The number of iterations so far, from 1."""
    residuals: Mapping[str, float]
    """The residuals by name."""
    residual: float
    """The largest residual, scaled so that the method has converged when it is at most `tol`."""
    estimate: npt.NDArray[np.float64]
    """The current estimate, in units of intensity; read-only."""
    tol: float
    """The tolerance of the run."""
    max_iter: int
    """The maximum number of iterations of the run."""

    @property
    def progress(self) -> float:
        """The completed fraction of the run in [0, 1], for a residual that decays exponentially."""
        if self.residual <= self.tol or self.tol >= 1:
            return 1.0
        return min(max(math.log(self.residual) / math.log(self.tol), 0.0), 1.0)


IterationCallback = Callable[[Iteration], object]
"""A function that is called after every iteration. It ends the run by raising StopIteration."""


@dataclasses.dataclass(frozen=True)
class ConvergenceHistory:
    """The history of an iterative method for one channel."""

    converged: bool
    """Whether the residuals reached `tol`."""
    residuals: dict[str, npt.NDArray[np.float64]]
    """The residuals by name, with one number per iteration."""
    objective: float
    """The minimized function, -ℓ plus the method's prior, at the final estimate in float64."""
    weight: float | npt.NDArray[np.floating] = 0.0
    """The weight of the prior: a number, or a map with one value for each pixel."""

    @property
    def iterations(self) -> int:
        """The number of iterations."""
        return len(next(iter(self.residuals.values())))

    def plot(self) -> "Figure":
        """Return a figure of the residuals over the iterations."""
        from jotlight.figures import Figure

        figure = Figure(6, 3.6)
        draw_residuals(figure.subplots(), self.residuals)
        return figure

    def __repr__(self) -> str:
        state = "converged" if self.converged else "not converged"
        last = ", ".join(f"{name} {values[-1]:.2g}" for name, values in self.residuals.items())
        return f"<ConvergenceHistory: {state} after {self.iterations} iterations, residuals {last}>"


def check_stopping_rule(max_iter: int, tol: float) -> tuple[int, float]:
    """Return `max_iter` as an int and `tol` as a float.

    Raises
    ------
    TypeError, ValueError
        When `max_iter` is not a whole number of at least 1, or `tol` is not finite and positive.

    Examples
    --------
    >>> check_stopping_rule(500, 1e-3)
    (500, 0.001)
    """
    if not isinstance(tol, float | int | np.number) or not 0 < tol < np.inf:
        raise ValueError(f"tol: expected a finite number above 0, got {tol!r}")
    try:
        iterations = operator.index(max_iter)
    except TypeError:
        raise TypeError(f"max_iter: expected a whole number, got {max_iter!r}") from None
    if iterations < 1:
        raise ValueError(f"max_iter: expected 1 or more, got {max_iter}")
    return iterations, float(tol)


class ConvergenceMonitor:
    """The stopping rule of one run. It records the residuals and calls the user's callback.

    Parameters
    ----------
    name : str
        The name of the method in warnings.
    max_iter : int
        The maximum number of iterations, at least 1.
    tol : float
        The method has converged when the scaled residuals are at most this large.
    callback : callable, optional
        A function that receives an :class:`Iteration` after each iteration.

    Raises
    ------
    TypeError, ValueError
        As in :func:`check_stopping_rule`.

    Examples
    --------
    >>> monitor = ConvergenceMonitor("halving", 10, 0.3, None)
    >>> estimate = np.ones(1)
    >>> while monitor.update(estimate, {"size": float(estimate[0])}):
    ...     estimate = estimate / 2
    >>> history = monitor.finish(objective=0.0)
    >>> history.converged, history.residuals["size"].tolist()
    (True, [1.0, 0.5, 0.25])
    """

    def __init__(
        self, name: str, max_iter: int, tol: float, callback: IterationCallback | None
    ) -> None:
        self.max_iter, self.tol = check_stopping_rule(max_iter, tol)
        self.converged = False
        self._name = name
        self._callback = callback
        self._residuals: list[Mapping[str, float]] = []
        self._residual = math.inf
        self._stopped_by_callback = False
        self._advice = "raise max_iter, or tol"

    @property
    def number(self) -> int:
        """The number of iterations so far."""
        return len(self._residuals)

    def update(
        self,
        estimate: npt.NDArray[np.float64],
        residuals: Mapping[str, float],
        tolerance_factors: Mapping[str, float] | None = None,
    ) -> bool:
        """Return whether the method has to continue, and record the iteration.

        The tolerance of each residual is `tol` times its factor in `tolerance_factors`, by default
        1.
        """
        self._residuals.append(residuals)
        factors = tolerance_factors or {}
        residual = max(value / factors.get(name, 1.0) for name, value in residuals.items())
        iteration = Iteration(
            self.number, residuals, residual, _readonly(estimate), self.tol, self.max_iter
        )
        self._residual = residual
        self.converged = residual <= self.tol
        if self._callback is not None:
            try:
                self._callback(iteration)
            except StopIteration:
                self._stopped_by_callback = True
        return not (
            self.converged or self._stopped_by_callback or iteration.number >= self.max_iter
        )

    def fail(self, reason: str) -> None:
        """Record why another iteration is impossible. The warning of `finish` shows the reason."""
        self._advice = reason

    def finish(
        self, objective: float, weight: float | npt.NDArray[np.floating] = 0.0
    ) -> ConvergenceHistory:
        """Return the history, and warn unless the method converged or the callback ended it."""
        residuals = {
            name: np.array([step[name] for step in self._residuals], np.float64)
            for name in self._residuals[0]
        }
        if not (self.converged or self._stopped_by_callback):
            last = ", ".join(f"{name} {values[-1]:.2g}" for name, values in residuals.items())
            plural = "" if self.number == 1 else "s"
            warn(
                f"{self._name}: not converged after {self.number} iteration{plural}: residual "
                f"{self._residual:.2g} ({last}), expected at most tol = {self.tol:g}; "
                f"{self._advice}"
            )
        return ConvergenceHistory(self.converged, residuals, objective, weight)


def _readonly(image: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    view = image.view()
    view.flags.writeable = False
    return view
