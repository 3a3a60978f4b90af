"""Maximum likelihood for any kernel, solved iteratively: equation (4)."""

from __future__ import annotations

import dataclasses
from typing import Literal, overload

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image, Mask
from jotlight.estimators.inpaint import fill_dead_pixels, warn_about_dead_pixels
from jotlight.estimators.iterative.convergence import (
    ConvergenceHistories,
    ConvergenceMonitor,
    IterationCallback,
)
from jotlight.estimators.iterative.descent import (
    SOLVERS,
    Direction,
    QuadraticModel,
    gradient_direction,
)
from jotlight.estimators.iterative.image_solver import SolverInputs, solve_images
from jotlight.parameter_names import check_choice
from jotlight.sensing.data.pixel_counts import Data
from jotlight.sensing.data.stacks import dots, each_image, replace, select
from jotlight.sensing.likelihood.problem import Problem
from jotlight.sensing.sensor import Sensor

_ARMIJO = 1e-4
"""The fraction of the decrease predicted by the gradient that a step must achieve (Armijo)."""

_ROUNDING = 1e-13
"""The relative difference of ℓ that rounding can cause."""

_MAX_HALVINGS = 40
"""The maximum number of halvings of a step."""

_MIN_LIGHT = 1e-3
"""The fraction of the scale of an image below which intensities are negligible, and dark counts in
their units."""

_MIN_RATIO = 0.1
"""The fraction of its intensity that a pixel keeps in a step if one of its bits needs light."""


@overload
def mle_iterative(
    data: Data | Problem,
    sensor: Sensor | None = None,
    *,
    solver: str = ...,
    trials: npt.ArrayLike | None = ...,
    channel_axis: int | None = ...,
    start: npt.ArrayLike | None = ...,
    max_iter: int = ...,
    tol: float = ...,
    callback: IterationCallback | None = ...,
    return_history: Literal[False] = ...,
    out: npt.NDArray[np.float32] | None = ...,
    threads: int | None = ...,
) -> Image: ...


@overload
def mle_iterative(
    data: Data | Problem,
    sensor: Sensor | None = None,
    *,
    solver: str = ...,
    trials: npt.ArrayLike | None = ...,
    channel_axis: int | None = ...,
    start: npt.ArrayLike | None = ...,
    max_iter: int = ...,
    tol: float = ...,
    callback: IterationCallback | None = ...,
    return_history: Literal[True],
    out: npt.NDArray[np.float32] | None = ...,
    threads: int | None = ...,
) -> tuple[Image, ConvergenceHistories]: ...


# More than 9 parameters: each is an independent keyword of a public estimator.
def mle_iterative(
    data: Data | Problem,
    sensor: Sensor | None = None,
    *,
    solver: str = "newton",
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    start: npt.ArrayLike | None = None,
    max_iter: int = 500,
    tol: float = 1e-6,
    callback: IterationCallback | None = None,
    return_history: bool = False,
    out: npt.NDArray[np.float32] | None = None,
    threads: int | None = None,
) -> Image | tuple[Image, ConvergenceHistories]:
    """Return the image in [0, S] that maximizes the likelihood of all bits, for any kernel.

    With the box kernel, the result equals that of :func:`jotlight.mle`. A smooth kernel blurs the
    light, and inverting the blur amplifies the noise. With few trials per pixel, the most likely
    image is therefore very noisy. :func:`jotlight.admm_tv` adds a regularization.

    Parameters
    ----------
    data : Bits, Merged, list of them, array_like of int, or Problem
        Bits; or merged counts, or counts L of shape (..., H, W), which suffice for the box kernel,
        and counts also for other kernels if a pixel is a jot; or a custom problem without a sensor,
        for signals (N,) and other operators. Each image of a stack stops by itself.
    sensor : Sensor, optional
        The sensor that recorded the data. Default: the one that bits or merged counts carry.
    solver : {"newton", "gradient"}
        "newton" computes Newton steps by conjugate gradients, on the pixels inside (0, S).
        "gradient" is the projected gradient. Both use a line search.
    trials : float or array_like of float, optional
        The number of binary readings behind each pixel of counts, 0 or more: a number, or a map of
        their shape. Default: the sensor's K.
    channel_axis : int, optional
        The axis of counts that holds color channels. Default: none, and axes before the last two
        are those of a stack.
    start : array_like of float, optional
        The initial image, of the shape of the estimate. Default: one intensity, except for pixels
        whose bits are all 0 or all 1, and for those that need more light.
    max_iter : int
        The maximum number of iterations, at least 1.
    tol : float
        The run ends when the projected-gradient step ``c - proj(c - ∇/h)`` moves no pixel by more
        than `tol` times the smaller of S and ten times the intensity of the best constant image.
        Here h is an upper bound of the curvature for each pixel. The step is 0 only at the maximum.
    callback : callable, optional
        A function that receives a :class:`jotlight.estimators.iterative.convergence.Iteration`
        after each iteration of each image. It ends the run of the image by raising StopIteration.
    return_history : bool
        Whether to return the history too: a
        :class:`jotlight.estimators.iterative.convergence.ConvergenceHistory`, or a list with one
        for each image of a stack and each channel.
    out : ndarray of float32, optional
        An array of the shape of the result to write to and return. Default: a new one.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    ndarray of float32
        Intensities in [0, S], of the shape of the counts. Estimates of color bits are (H, W, C).
        With `return_history`, a tuple of the estimate and the history.

    Raises
    ------
    TypeError, ValueError
        When data, sensor, trials, start and out do not fit together, or a parameter is out of its
        range.

    Warns
    -----
    JotlightWarning
        When the run did not converge, and when pixels without a valid bit were inpainted from their
        neighbors.

    Notes
    -----
    Paper, equation (4). The projected gradient is that of its reference [5]. Newton's method on the
    free pixels is the two-metric projection of Bertsekas (1982).

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=4, frames=64, kernel="quadratic")
    >>> image = np.outer(np.linspace(0.2, 0.8, 8), np.ones(8))
    >>> bits = sensor.expose(image, rng=0)
    >>> estimate, history = jl.mle_iterative(bits, sensor, return_history=True)
    >>> history.converged, bool(abs(estimate - image).mean() < 0.1)
    (True, True)
    """
    check_choice("solver", solver, SOLVERS)
    monitor = ConvergenceMonitor("mle_iterative", max_iter, tol, callback)
    dead: list[Mask] = []

    def solve(problem: Problem, start: Array | None) -> Array:
        image = _maximize(problem, start, SOLVERS[solver], monitor)
        dead.append(~_pixels_with(problem, _trials(problem) > 0))
        return fill_dead_pixels(image, dead[-1])

    inputs = SolverInputs(data, sensor, trials, channel_axis, start, out, threads)
    estimate, history = solve_images(solve, monitor, inputs)
    warn_about_dead_pixels(np.concatenate(dead))
    return (estimate, history) if return_history else estimate


@dataclasses.dataclass
class _State:
    """The images of a stack that are not finished, (N, ...)."""

    problem: Problem
    image: Array
    light: Array
    cost: Array
    """-ℓ of each image, (N,)."""
    needs_light: Mask
    """The pixels that must have light."""
    scale: Array
    """The scale of the intensities of each image, (N,)."""

    def select(self, images: Mask) -> _State:
        """Return the state of the images of a mask (N,)."""
        return _State(
            self.problem.select(images),
            select(self.image, images),
            select(self.light, images),
            select(self.cost, images),
            select(self.needs_light, images),
            select(self.scale, images),
        )


def _maximize(
    problem: Problem, start: Array | None, find_direction: Direction, monitor: ConvergenceMonitor
) -> Array:
    """Return the images of a stack. The monitor records their histories."""
    light_of_ones = problem.operator.forward(np.ones(problem.operator.input_shape))
    state = _initial_state(problem, start, light_of_ones)
    results, costs = np.empty(state.image.shape), np.empty(len(state.image))
    monitor.begin(len(results))
    while len(active := monitor.active):
        model = QuadraticModel(state.problem, state.light, light_of_ones)
        residual = _residuals(state, model)
        unfinished = monitor.update(state.image, {"projected gradient": residual})
        if not unfinished.all():
            ended = active[~unfinished]
            results[ended], costs[ended] = state.image[~unfinished], state.cost[~unfinished]
            if not unfinished.any():
                break
            state, model = state.select(unfinished), model.select(unfinished)
            residual = select(residual, unfinished)
        left = _step(state, model, residual, find_direction)
        if left.any():
            ended = monitor.active[left]
            results[ended], costs[ended] = state.image[left], state.cost[left]
            monitor.give_up(left, "rounding hides the progress of any step; raise tol")
            state = state.select(~left)
    monitor.finish(costs)
    return results


def _initial_state(problem: Problem, start: Array | None, light_of_ones: Array) -> _State:
    """Return the state before the first step."""
    likelihood, max_intensity = problem.likelihood, problem.max_intensity
    if start is None:
        level = problem.constant_estimates()
        start = each_image(level, likelihood.ones) * np.ones(problem.operator.input_shape)
    # The most likely intensity of a pixel is 0 if all its bits are 0, and S if all are 1.
    ones = likelihood.ones > 0
    any_one = _pixels_with(problem, ones)
    any_zero = _pixels_with(problem, _trials(problem) - likelihood.ones > 0)
    image = np.where(any_one, np.where(any_zero, start, max_intensity), 0.0)
    # A bit of 1 that dark counts hardly explain needs light. Without light and dark counts, ℓ is
    # -inf.
    scale = problem.intensity_scales()
    least = _MIN_LIGHT * each_image(scale, image)
    faint = likelihood.dark_counts <= _MIN_LIGHT * each_image(scale, ones) * light_of_ones
    needs_light = _pixels_with(problem, ones & faint)
    image = np.where(needs_light, np.maximum(image, least), image)
    light = problem.operator.forward(image)
    return _State(problem, image, light, -likelihood.values(light), needs_light, scale)


def _residuals(state: _State, model: QuadraticModel) -> Array:
    """Return the largest change of each image by the projected gradient, over its scale, (N,)."""
    image, max_intensity = state.image, state.problem.max_intensity
    move = np.abs(image - np.clip(image - model.scaled_gradient(), 0, max_intensity))
    return np.asarray(move.reshape(len(image), -1).max(axis=1) / state.scale)


def _step(state: _State, model: QuadraticModel, residual: Array, find_direction: Direction) -> Mask:
    """Move the images so that their costs fall. Return the mask of those that no step moves.

    Pixels near a bound stay there while the gradient draws them to it.
    """
    image, max_intensity = state.image, state.problem.max_intensity
    margin = each_image(np.minimum(residual, 1e-3) * state.scale, image)
    fixed = ((image <= margin) & (model.gradient > 0)) | (
        (image >= max_intensity - margin) & (model.gradient < 0)
    )
    # If Newton's direction does not lower the cost, the gradient does, except for rounding.
    left = np.ones(len(image), np.bool_)
    for direction in (find_direction, gradient_direction):
        left = _line_search(state, left, model.gradient, direction(model, ~fixed))
        if not left.any():
            break
    return left


def _line_search(state: _State, left: Mask, gradient: Array, direction: Array) -> Mask:
    """Move each image of a mask by the first halved step that lowers the cost enough.

    Return the mask of those that no step moves.
    """
    problem = state.problem
    lowest = np.where(state.needs_light, _MIN_RATIO * state.image, 0.0)
    for halvings in range(_MAX_HALVINGS):
        image, lower, step, slope, cost = (
            select(each, left) for each in (state.image, lowest, direction, gradient, state.cost)
        )
        candidate = np.clip(image + 0.5**halvings * step, lower, problem.max_intensity)
        light = problem.operator.forward(candidate)
        new_cost = -problem.select(left).likelihood.values(light)
        predicted = dots(slope, image - candidate)
        moved = new_cost <= cost - _ARMIJO * predicted + _ROUNDING * abs(cost)
        places = left.copy()
        places[left] = moved
        state.image = replace(state.image, places, select(candidate, moved))
        state.light = replace(state.light, places, select(light, moved))
        state.cost = replace(state.cost, places, select(new_cost, moved))
        left = left & ~places
        if not left.any():
            break
    return left


def _pixels_with(problem: Problem, cells: Mask) -> Mask:
    """Return the mask of the pixels that cast light on any of the marked cells."""
    return np.asarray(problem.operator.adjoint(cells.astype(np.float64)) > 0)


def _trials(problem: Problem) -> Array:
    return np.broadcast_to(np.asarray(problem.likelihood.trials), problem.likelihood.shape)
