"""Maximum likelihood for any kernel, step by step: equation (4)."""

from collections.abc import Callable
from typing import Literal, overload

import numpy as np
import numpy.typing as npt

from jotlight.estimators.convergence import Callback, ConvergenceHistory, ConvergenceMonitor
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.estimators.problem import ConvergenceHistories, solve_channels
from jotlight.sensing.bits import Bits
from jotlight.sensing.likelihood import Array, Problem
from jotlight.sensing.operators import dot
from jotlight.sensing.sensor import Sensor

Picture = npt.NDArray[np.float32]

_ENOUGH = 1e-4
"""The share of the decrease that the gradient promises which a step has to keep (Armijo)."""

_ROUNDING = 1e-13
"""Differences of ℓ below this share of it are rounding."""

_HALVINGS = 40
"""Of a step at most."""

_FAINT = 1e-3
"""The share of S below which light, or dark counts for it, are next to none."""

_KEPT = 0.1
"""A pixel that must not become 0 at once keeps this share of itself in a step."""


@overload
def mle_iterative(
    data: Bits | Problem | npt.ArrayLike,
    sensor: Sensor | None = None,
    *,
    solver: str = ...,
    start: npt.ArrayLike | None = ...,
    max_iter: int = ...,
    tol: float = ...,
    callback: Callback | None = ...,
    return_history: Literal[False] = ...,
    threads: int | None = ...,
) -> Picture: ...


@overload
def mle_iterative(
    data: Bits | Problem | npt.ArrayLike,
    sensor: Sensor | None = None,
    *,
    solver: str = ...,
    start: npt.ArrayLike | None = ...,
    max_iter: int = ...,
    tol: float = ...,
    callback: Callback | None = ...,
    return_history: Literal[True],
    threads: int | None = ...,
) -> tuple[Picture, ConvergenceHistories]: ...


def mle_iterative(
    data: Bits | Problem | npt.ArrayLike,
    sensor: Sensor | None = None,
    *,
    solver: str = "newton",
    start: npt.ArrayLike | None = None,
    max_iter: int = 500,
    tol: float = 1e-6,
    callback: Callback | None = None,
    return_history: bool = False,
    threads: int | None = None,
) -> Picture | tuple[Picture, ConvergenceHistories]:
    """Find the image in [0, S] that makes all bits together most likely, for any kernel.

    With the box kernel that is what :func:`jotlight.mle` gives at once. A smooth kernel spreads the
    light, and taking that back amplifies the noise: at few bits per pixel the most likely image is
    far noisier than the light that it casts on the jots. :func:`jotlight.admm_tv` holds it back.

    Parameters
    ----------
    data : Bits, array_like of int, or Problem
        Bits, or an image of counts L of shape (H, W) or (H, W, C), which serves for the box
        kernel; or a problem of your own, for signals (N,) and other operators, without a sensor.
    sensor : Sensor
        What made the data.
    solver : {"newton", "gradient"}
        Newton's method, its steps found by conjugate gradients on the pixels that are not held at 0
        or S; or the projected gradient. Both with a line search.
    start : array_like of float, optional
        Where to begin, of the picture's shape. Default: the same intensity everywhere.
    max_iter : int
        Iterations at most; a JotlightWarning says when they were not enough.
    tol : float
        The run ends when no pixel would move by more than this share of S in a projected-gradient
        step ``c - proj(c - ∇/h)``, h an upper bound of the curvature, pixel by pixel. That step is
        0 at the maximum and nowhere else.
    callback : callable, optional
        Called with a :class:`jotlight.estimators.convergence.Iteration` after each; raises StopIteration to
        end the run.
    return_history : bool
        Give a :class:`jotlight.estimators.convergence.ConvergenceHistory` too, or a list of them, one for each channel.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    ndarray of float32, shape (H, W) or (H, W, C)
        Intensities in [0, S]. With `return_history` a tuple of it and the history.

    Raises
    ------
    TypeError, ValueError
        When data, sensor and start do not fit, or a parameter is out of its range.

    Warns
    -----
    JotlightWarning
        When the run did not converge, and when pixels of which no valid jot sees anything were
        filled from their neighbours.

    Notes
    -----
    Paper, equation (4); the projected gradient is that of its reference [5]. Newton's method on the
    free pixels is the two-metric projection of Bertsekas (1982).

    Examples
    --------
    >>> sensor = Sensor(oversampling=4, frames=64, kernel="quadratic")
    >>> scene = np.outer(np.linspace(0.2, 0.8, 8), np.ones(8))
    >>> picture, history = mle_iterative(sensor.expose(scene, rng=0), sensor, return_history=True)
    >>> history.converged, bool(abs(picture - scene).mean() < 0.1)
    (True, True)
    """
    if solver not in SOLVERS:
        raise ValueError(f"solver: expected one of {', '.join(SOLVERS)}, got {solver!r}")
    ConvergenceMonitor(
        "mle_iterative", max_iter, tol, None
    )  # what is wrong with them is said at once

    def solve(
        problem: Problem, begin: Array | None, channel: str
    ) -> tuple[Array, ConvergenceHistory]:
        watch = ConvergenceMonitor("mle_iterative" + channel, max_iter, tol, callback)
        image, history = _maximise(problem, begin, SOLVERS[solver], watch)
        blind = problem.operator.adjoint((_trials(problem) > 0).astype(np.float64)) == 0
        if blind.any():
            image = inpaint_dead_pixels(image.astype(np.float32), blind).astype(np.float64)
        return image, history

    picture, history = solve_channels(solve, data, sensor, start, threads)
    return (picture, history) if return_history else picture


class _Slopes:
    """-ℓ around an image: its gradient, and what is known of its curvature."""

    def __init__(self, problem: Problem, light: Array, spread_of_ones: Array) -> None:
        gradient, self.curvature = problem.likelihood.gradient_and_curvature(light)
        self.most = problem.max_intensity
        self.operator = problem.operator
        self.gradient = -self.operator.adjoint(gradient)
        # Aᵀ W A ≤ diag(Aᵀ W A 1), since A has no negative entries.
        self.bound = self.operator.adjoint(self.curvature * spread_of_ones)

    def scaled(self) -> Array:
        """Give the gradient over the bound of the curvature, no longer than the box is wide."""
        # Where there is no curvature, the slope alone says which way to go, and the box how far.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = self.gradient / self.bound
        return np.clip(np.nan_to_num(step, nan=0.0), -self.most, self.most)

    def hessian(self, direction: Array) -> Array:
        """Give Aᵀ W A `direction`."""
        return self.operator.normal(self.curvature, direction)


Direction = Callable[[_Slopes, npt.NDArray[np.bool_]], Array]


def _gradient_direction(slopes: _Slopes, free: npt.NDArray[np.bool_]) -> Array:
    return -slopes.scaled()


def _newton_direction(slopes: _Slopes, free: npt.NDArray[np.bool_]) -> Array:
    """Solve the Newton equations on the free pixels by conjugate gradients, as far as it pays."""
    direction = np.where(free, 0.0, -slopes.scaled())
    solution = np.zeros_like(direction)
    residual = np.where(free, -slopes.gradient, 0.0)
    inverse = np.where(free & (slopes.bound > 0), 1 / np.maximum(slopes.bound, 1e-300), 0.0)
    preconditioned = inverse * residual
    search = preconditioned
    size = first = dot(residual, preconditioned)
    for _ in range(_CG_STEPS):
        if size <= _CG_ENOUGH**2 * first:
            break
        product = np.where(free, slopes.hessian(search), 0.0)
        bend = dot(search, product)
        if bend <= _FLAT * dot(search, slopes.bound * search):
            break
        step = size / bend
        solution += step * search
        residual = residual - step * product
        preconditioned = inverse * residual
        size, before = dot(residual, preconditioned), size
        search = preconditioned + size / before * search
    # Where the likelihood is flat from the start, the gradient is all there is.
    return direction + np.where(free, solution if solution.any() else -slopes.scaled(), 0.0)


_CG_STEPS = 30
_CG_ENOUGH = 0.3
"""Newton's equations are solved until the residual has fallen to this share; more does not pay."""

_FLAT = 1e-4
"""A direction with less than this share of the bound of the curvature is one that rounding made."""

SOLVERS: dict[str, Direction] = {"newton": _newton_direction, "gradient": _gradient_direction}
"""Ways to walk up the likelihood."""


def _maximise(
    problem: Problem, begin: Array | None, direction_of: Direction, watch: ConvergenceMonitor
) -> tuple[Array, ConvergenceHistory]:
    operator, likelihood, most = problem.operator, problem.likelihood, problem.max_intensity
    spread_of_ones = operator.forward(np.ones(operator.input_shape))
    image = np.full(operator.input_shape, problem.constant_estimate()) if begin is None else begin
    # A pixel all of whose bits are 0, or 1, is as dark, or bright, as can be.
    ones, zeros = likelihood.ones, _trials(problem) - likelihood.ones
    fired = operator.adjoint((ones > 0).astype(np.float64)) > 0
    stayed_dark = operator.adjoint((zeros > 0).astype(np.float64)) > 0
    image = np.where(fired, np.where(stayed_dark, image, most), 0.0)
    # Where a bit fired and hardly any dark count explains it, there is some light.
    faint = likelihood.dark_counts <= _FAINT * most * spread_of_ones
    needs_light = operator.adjoint(((ones > 0) & faint) * 1.0) > 0
    image = np.where(needs_light, np.maximum(image, _FAINT * most), image)

    light = operator.forward(image)
    cost = -likelihood.value(light)
    while True:
        slopes = _Slopes(problem, light, spread_of_ones)
        move = image - np.clip(image - slopes.scaled(), 0, most)
        residual = float(np.abs(move).max() / most)
        if not watch.update(image, {"projected gradient": residual}):
            break
        near = min(residual, 1e-3) * most
        held = ((image <= near) & (slopes.gradient > 0)) | (
            (image >= most - near) & (slopes.gradient < 0)
        )
        least = np.where(needs_light, _KEPT * image, 0.0)
        # Where Newton's direction leads nowhere the gradient's does, down to rounding.
        for direct in (direction_of, _gradient_direction):
            found = _search(problem, image, cost, slopes.gradient, direct(slopes, ~held), least)
            if found is not None:
                break
        else:
            watch.give_up("rounding hides what a step would gain; raise tol")
            break
        image, light, cost = found
    return image, watch.finish(cost)


def _search(
    problem: Problem, image: Array, cost: float, gradient: Array, direction: Array, least: Array
) -> tuple[Array, Array, float] | None:
    """Halve a step until it lowers the cost enough; give the image, its light and its cost."""
    for halvings in range(_HALVINGS):
        tried = np.clip(image + 0.5**halvings * direction, least, problem.max_intensity)
        light = problem.operator.forward(tried)
        tried_cost = -problem.likelihood.value(light)
        promised = dot(gradient, image - tried)
        if tried_cost <= cost - _ENOUGH * promised + _ROUNDING * abs(cost):
            return tried, light, tried_cost
    return None


def _trials(problem: Problem) -> npt.NDArray[np.int32]:
    return np.broadcast_to(
        np.asarray(problem.likelihood.trials, np.int32), problem.likelihood.shape
    )
