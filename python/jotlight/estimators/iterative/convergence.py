"""Progress and convergence of the iterative methods: callbacks, the stopping rule, the history."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.arrays import read_only
from jotlight.checks import positive_number, whole_number
from jotlight.errors import counted, warn
from jotlight.estimators.planning.figure import draw_residuals
from jotlight.notebook import card

if TYPE_CHECKING:
    from jotlight.figures import Figure


@dataclasses.dataclass(frozen=True, eq=False)
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
    image: int = 0
    """The gray image: its number in the stack, counted with channels, from 0."""

    @property
    def progress(self) -> float:
        """The completed fraction of the run in [0, 1], for a residual that decays exponentially."""
        if self.residual <= self.tol or self.tol >= 1:
            return 1.0
        return min(max(math.log(self.residual) / math.log(self.tol), 0.0), 1.0)


IterationCallback = Callable[[Iteration], object]
"""A function that is called after every iteration of each image.

By raising StopIteration it ends the run of the image."""

Residuals = Mapping[str, npt.NDArray[np.float64]]
"""Residuals by name, one number for each image or each iteration."""


@dataclasses.dataclass(frozen=True, eq=False)
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

    def _repr_html_(self) -> str:
        state = "converged" if self.converged else "not converged"
        facts: dict[str, object] = {"state": state, "iterations": self.iterations}
        facts |= {f"last {name}": f"{values[-1]:.2g}" for name, values in self.residuals.items()}
        facts["objective"] = f"{self.objective:.6g}"
        return card("ConvergenceHistory", facts, self.plot().thumbnail())

    def __repr__(self) -> str:
        state = "converged" if self.converged else "not converged"
        last = ", ".join(f"{name} {values[-1]:.2g}" for name, values in self.residuals.items())
        return f"<ConvergenceHistory: {state} after {self.iterations} iterations, residuals {last}>"


ConvergenceHistories = ConvergenceHistory | Any
"""The history of a gray image, or a list with that of each image of a stack and each channel.

The type of data cannot tell which. Any lets callers use a list without a check of its type.
"""


def follow_slowest(show: IterationCallback) -> IterationCallback:
    """Return a callback that shows only the image of a stack that has the longest way to go.

    Examples
    --------
    >>> def step(image, residual):
    ...     return Iteration(1, {}, residual, np.zeros(1), 1e-3, 9, image)
    >>> callback = follow_slowest(lambda step: print(f"{step.progress:.2f}"))
    >>> for step_of_image in (step(0, 0.1), step(1, 0.01), step(0, 1e-3)):
    ...     callback(step_of_image)
    0.33
    0.33
    0.67
    """
    latest: dict[int, Iteration] = {}

    def callback(step: Iteration) -> None:
        latest[step.image] = step
        show(min(latest.values(), key=lambda each: each.progress))

    return callback


class ConvergenceMonitor:
    """The stopping rule of a method, which runs on all images of a group at once.

    Each image stops by itself. The monitor records its residuals and calls the user's callback.

    Parameters
    ----------
    name : str
        The name of the method in warnings.
    max_iter : int
        The maximum number of iterations, at least 1.
    tol : float
        An image has converged when its scaled residuals are at most this large.
    callback : callable, optional
        A function that receives an :class:`Iteration` of each image after each iteration.

    Raises
    ------
    TypeError, ValueError
        When `max_iter` is not a whole number of at least 1, or `tol` is not finite and above 0.

    Examples
    --------
    >>> monitor = ConvergenceMonitor("halving", 10, 0.3, None)
    >>> monitor.begin(2)
    >>> estimates = np.array([[1.0], [0.5]])
    >>> while (unfinished := monitor.update(estimates, {"size": estimates[:, 0]})).any():
    ...     estimates = estimates[unfinished] / 2
    >>> monitor.finish(objectives=np.zeros(2))
    >>> [history.residuals["size"].tolist() for history in monitor.histories]
    [[1.0, 0.5, 0.25], [0.5, 0.25]]
    """

    def __init__(
        self, name: str, max_iter: int, tol: float, callback: IterationCallback | None
    ) -> None:
        self.max_iter = whole_number("max_iter", max_iter, 1)
        self.tol = positive_number("tol", tol)
        self.histories: list[ConvergenceHistory] = []
        """The histories of the images of all groups that have ended."""
        self._name = name
        self._callback = callback
        self._failures: list[tuple[float, int, str]] = []

    def begin(self, images: int) -> None:
        """Begin with a group of images."""
        self.number = 0
        """The number of iterations so far."""
        self.active = np.arange(images)
        """The images of the group that go on."""
        self._records: list[tuple[npt.NDArray[np.intp], Residuals]] = []
        self._residual = np.full(images, math.inf)
        self._converged, self._stopped = np.zeros(images, np.bool_), np.zeros(images, np.bool_)
        self._advice = dict.fromkeys(range(images), "raise max_iter, or tol")

    def update(
        self,
        estimates: npt.NDArray[np.float64],
        residuals: Residuals,
        tolerance_factors: Mapping[str, float] | None = None,
    ) -> npt.NDArray[np.bool_]:
        """Return which of the active images have to go on, and record the iteration.

        `estimates` and `residuals` are those of the active images. The tolerance of each residual
        is `tol` times its factor in `tolerance_factors`, by default 1.
        """
        self.number += 1
        self._records.append((self.active, residuals))
        factors = tolerance_factors or {}
        scaled = [values / factors.get(name, 1.0) for name, values in residuals.items()]
        residual = np.max(scaled, axis=0)
        self._residual[self.active] = residual
        converged = residual <= self.tol
        self._converged[self.active] = converged
        stopped = np.zeros(converged.shape, np.bool_)
        if self._callback is not None:
            for place, image in enumerate(self.active):
                iteration = Iteration(
                    self.number,
                    {name: float(values[place]) for name, values in residuals.items()},
                    float(residual[place]),
                    read_only(estimates[place]),
                    self.tol,
                    self.max_iter,
                    len(self.histories) + int(image),
                )
                try:
                    self._callback(iteration)
                except StopIteration:
                    stopped[place] = True
        self._stopped[self.active] = stopped
        unfinished: npt.NDArray[np.bool_] = ~(converged | stopped) & (self.number < self.max_iter)
        self.active = self.active[unfinished]
        return unfinished

    def give_up(self, images: npt.NDArray[np.bool_], reason: str) -> None:
        """End the run of active images, for a reason that the warning shows."""
        self._advice.update(dict.fromkeys(self.active[images].tolist(), reason))
        self.active = self.active[~images]

    def finish(
        self,
        objectives: npt.NDArray[np.float64],
        weights: float | npt.NDArray[np.floating] = 0.0,
    ) -> None:
        """Record the histories of the group, with the weight of all or a map for each image."""
        first, number = len(self.histories), len(objectives)
        lengths = np.zeros(number, np.intp)
        for active, _ in self._records:
            lengths[active] += 1
        columns = {name: np.zeros((number, self.number)) for name in self._records[0][1]}
        for step, (active, residuals) in enumerate(self._records):
            for name, values in residuals.items():
                columns[name][active, step] = values
        for image in range(number):
            each = {name: values[image, : lengths[image]] for name, values in columns.items()}
            weight = weights[image] if isinstance(weights, np.ndarray) else weights
            converged = bool(self._converged[image])
            self.histories.append(
                ConvergenceHistory(converged, each, float(objectives[image]), weight)
            )
            if not (converged or self._stopped[image]):
                failure = self._describe_failure(each, float(self._residual[image]))
                text = f"{failure}; {self._advice[image]}"
                self._failures.append((float(self._residual[image]), first + image, text))

    def _describe_failure(self, residuals: Residuals, residual: float) -> str:
        last = ", ".join(f"{name} {values[-1]:.2g}" for name, values in residuals.items())
        number = len(next(iter(residuals.values())))
        return (
            f"not converged after {counted(number, 'iteration')}: residual "
            f"{residual:.2g} ({last}), expected at most tol = {self.tol:g}"
        )

    def warn(self, name_of: Callable[[int], str]) -> None:
        """Warn once about the images that did not converge and that no callback ended.

        `name_of` returns the name of an image in messages, or "" for an only one.
        """
        if not self._failures:
            return
        _, worst, text = max(self._failures, key=lambda failure: failure[0])
        if name := name_of(worst):
            number = len(self._failures)
            others = f" and {number - 1} more of {len(self.histories)}" if number > 1 else ""
            name = f", {name}{others}"
        warn(f"{self._name}{name}: {text}")
