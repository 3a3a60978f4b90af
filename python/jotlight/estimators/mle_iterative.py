"""Maximum likelihood for any kernel, solved iteratively: equation (4)."""

from collections.abc import Callable
from typing import Literal, overload

import numpy as np
import numpy.typing as npt

from jotlight.estimators.convergence import (
    ConvergenceHistory,
    ConvergenceMonitor,
    IterationCallback,
    check_stopping_rule,
)
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.estimators.problem import ConvergenceHistories, solve_images
from jotlight.sensing.likelihood import Problem
from jotlight.sensing.operators import dot
from jotlight.sensing.pixel_counts import Data, Estimate
from jotlight.sensing.response import Array
from jotlight.sensing.sensor import Sensor

Mask = npt.NDArray[np.bool_]

_ARMIJO = 1e-4
"""The fraction of the decrease predicted by the gradient that a step must achieve (Armijo)."""

_ROUNDING = 1e-13
"""The relative difference of ℓ that rounding can cause."""

_MAX_HALVINGS = 40
"""The maximum number of halvings of a step."""

_MIN_LIGHT = 1e-3
"""The fraction of S below which intensities are negligible, and dark counts in their units."""

_MIN_RATIO = 0.1
"""The fraction of its intensity that a pixel keeps in a step if one of its bits needs light."""

_MAX_CG_STEPS = 30
"""The maximum number of steps of conjugate gradients in Newton's method."""

_CG_TOLERANCE = 0.3
"""The relative residual at which Newton's equations count as solved. Smaller is not faster."""

_MIN_CURVATURE = 1e-4
"""The fraction of its upper bound below which a direction's curvature is a rounding error."""


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
    threads: int | None = ...,
) -> Estimate: ...


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
    threads: int | None = ...,
) -> tuple[Estimate, ConvergenceHistories]: ...


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
    threads: int | None = None,
) -> Estimate | tuple[Estimate, ConvergenceHistories]:
    """Return the image in [0, S] that maximizes the likelihood of all bits, for any kernel.

    With the box kernel, the result equals that of :func:`jotlight.mle`. A smooth kernel blurs the
    light, and inverting the blur amplifies the noise. With few trials per pixel, the most likely
    image is therefore very noisy. :func:`jotlight.admm_tv` adds a regularization.

    Parameters
    ----------
    data : Bits, Merged, list of them, array_like of int, or Problem
        Bits; or merged counts, or counts L of shape (..., H, W), which suffice for the box kernel;
        or a custom problem without a sensor, for signals (N,) and other operators. Each image of a
        stack stops by itself.
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
        The initial image, of the shape of the estimate. Default: the same intensity everywhere.
    max_iter : int
        The maximum number of iterations, at least 1.
    tol : float
        The run ends when the projected-gradient step ``c - proj(c - ∇/h)`` moves no pixel by more
        than `tol` S. Here h is an upper bound of the curvature for each pixel. The step is 0 only
        at the maximum.
    callback : callable, optional
        A function that receives a :class:`jotlight.estimators.convergence.Iteration` after each
        iteration. It ends the run by raising StopIteration.
    return_history : bool
        Whether to return the history too: a
        :class:`jotlight.estimators.convergence.ConvergenceHistory`, or a list with one for each
        image of a stack and each channel.
    threads : int, optional
        The number of threads. Default: all cores.

    Returns
    -------
    ndarray of float32
        Intensities in [0, S], of the shape of the counts. Estimates of color bits are (H, W, C).
        With `return_history`, a tuple of the estimate and the history.

    Raises
    ------
    TypeError, ValueError
        When data, sensor, trials and start do not fit together, or a parameter is out of its range.

    Warns
    -----
    JotlightWarning
        When the run did not converge, and when pixels without a valid bit were filled from their
        neighbors.

    Notes
    -----
    Paper, equation (4). The projected gradient is that of its reference [5]. Newton's method on the
    free pixels is the two-metric projection of Bertsekas (1982).

    Examples
    --------
    >>> sensor = Sensor(oversampling=4, frames=64, kernel="quadratic")
    >>> image = np.outer(np.linspace(0.2, 0.8, 8), np.ones(8))
    >>> bits = sensor.expose(image, rng=0)
    >>> estimate, history = mle_iterative(bits, sensor, return_history=True)
    >>> history.converged, bool(abs(estimate - image).mean() < 0.1)
    (True, True)
    """
    if solver not in SOLVERS:
        raise ValueError(f"solver: expected one of {', '.join(SOLVERS)}, got {solver!r}")
    check_stopping_rule(max_iter, tol)

    def solve(problem: Problem, start: Array | None, name: str) -> tuple[Array, ConvergenceHistory]:
        monitor = ConvergenceMonitor("mle_iterative" + name, max_iter, tol, callback)
        image, history = _maximize(problem, start, SOLVERS[solver], monitor)
        dead = ~_pixels_with(problem, _trials(problem) > 0)
        if dead.any():
            image = inpaint_dead_pixels(image.astype(np.float32), dead).astype(np.float64)
        return image, history

    estimate, history = solve_images(solve, data, sensor, trials, channel_axis, start, threads)
    return (estimate, history) if return_history else estimate


class _QuadraticModel:
    """The gradient of -ℓ at an image, the Hessian AᵀWA, and its diagonal upper bound."""

    def __init__(self, problem: Problem, light: Array, light_of_ones: Array) -> None:
        gradient, self.curvature = problem.likelihood.gradient_and_curvature(light)
        self.max_intensity = problem.max_intensity
        self.operator = problem.operator
        self.gradient = -self.operator.adjoint(gradient)
        # AᵀWA ≤ diag(AᵀWA 1), since A has no negative entries.
        self.bound = self.operator.adjoint(self.curvature * light_of_ones)

    def scaled_gradient(self) -> Array:
        """Return the gradient divided by the bound of the Hessian, and clipped to [-S, S]."""
        # Without curvature the quotient is infinite, and clipping turns it into a step of length S.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = self.gradient / self.bound
        return np.clip(np.nan_to_num(step, nan=0.0), -self.max_intensity, self.max_intensity)

    def hessian_product(self, direction: Array) -> Array:
        """Return AᵀWA `direction`."""
        return self.operator.normal(self.curvature, direction)


Direction = Callable[[_QuadraticModel, Mask], Array]
"""A function that returns a descent direction of -ℓ for a model and the mask of free pixels."""


def _gradient_direction(model: _QuadraticModel, free: Mask) -> Array:
    return -model.scaled_gradient()


def _newton_direction(model: _QuadraticModel, free: Mask) -> Array:
    """Return the solution of Newton's equations on the free pixels, by conjugate gradients.

    They stop at a direction without curvature, which scipy.sparse.linalg.cg does not detect.
    """
    direction = np.where(free, 0.0, -model.scaled_gradient())
    solution = np.zeros_like(direction)
    residual = np.where(free, -model.gradient, 0.0)
    inverse = np.where(free & (model.bound > 0), 1 / np.maximum(model.bound, 1e-300), 0.0)
    preconditioned = inverse * residual
    search = preconditioned
    norm = first_norm = dot(residual, preconditioned)
    for _ in range(_MAX_CG_STEPS):
        if norm <= _CG_TOLERANCE**2 * first_norm:
            break
        product = np.where(free, model.hessian_product(search), 0.0)
        curvature = dot(search, product)
        if curvature <= _MIN_CURVATURE * dot(search, model.bound * search):
            break
        step = norm / curvature
        solution += step * search
        residual = residual - step * product
        preconditioned = inverse * residual
        norm, previous_norm = dot(residual, preconditioned), norm
        search = preconditioned + norm / previous_norm * search
    # If even the first direction has no curvature, the step follows the gradient.
    step_on_free = solution if solution.any() else -model.scaled_gradient()
    return direction + np.where(free, step_on_free, 0.0)


SOLVERS: dict[str, Direction] = {"newton": _newton_direction, "gradient": _gradient_direction}
"""The descent directions by the name of the solver."""


def _maximize(
    problem: Problem, start: Array | None, find_direction: Direction, monitor: ConvergenceMonitor
) -> tuple[Array, ConvergenceHistory]:
    operator, max_intensity = problem.operator, problem.max_intensity
    light_of_ones = operator.forward(np.ones(operator.input_shape))
    image, needs_light = _initial_image(problem, start, light_of_ones)
    light = operator.forward(image)
    cost = -problem.likelihood.value(light)
    while True:
        model = _QuadraticModel(problem, light, light_of_ones)
        move = image - np.clip(image - model.scaled_gradient(), 0, max_intensity)
        residual = float(np.abs(move).max() / max_intensity)
        if not monitor.update(image, {"projected gradient": residual}):
            break
        margin = min(residual, 1e-3) * max_intensity
        fixed = ((image <= margin) & (model.gradient > 0)) | (
            (image >= max_intensity - margin) & (model.gradient < 0)
        )
        lower = np.where(needs_light, _MIN_RATIO * image, 0.0)
        # If Newton's direction does not lower the cost, the gradient does, except for rounding.
        for direction in (find_direction, _gradient_direction):
            step = _line_search(
                problem, image, cost, model.gradient, direction(model, ~fixed), lower
            )
            if step is not None:
                break
        else:
            monitor.fail("rounding hides the progress of any step; raise tol")
            break
        image, light, cost = step
    return image, monitor.finish(cost)


def _initial_image(
    problem: Problem, start: Array | None, light_of_ones: Array
) -> tuple[Array, Mask]:
    """Return the image before the first step, and the mask of the pixels that must have light."""
    likelihood, max_intensity = problem.likelihood, problem.max_intensity
    if start is None:
        start = np.full(problem.operator.input_shape, problem.constant_estimate())
    # The most likely intensity of a pixel is 0 if all its bits are 0, and S if all are 1.
    ones = likelihood.ones > 0
    any_one = _pixels_with(problem, ones)
    any_zero = _pixels_with(problem, _trials(problem) - likelihood.ones > 0)
    image = np.where(any_one, np.where(any_zero, start, max_intensity), 0.0)
    # A bit of 1 that dark counts hardly explain needs light. Without light and dark counts, ℓ is
    # -inf.
    faint = likelihood.dark_counts <= _MIN_LIGHT * max_intensity * light_of_ones
    needs_light = _pixels_with(problem, ones & faint)
    return np.where(needs_light, np.maximum(image, _MIN_LIGHT * max_intensity), image), needs_light


def _line_search(
    problem: Problem, image: Array, cost: float, gradient: Array, direction: Array, lower: Array
) -> tuple[Array, Array, float] | None:
    """Return image, light, and cost after the first halved step that lowers the cost enough."""
    for halvings in range(_MAX_HALVINGS):
        candidate = np.clip(image + 0.5**halvings * direction, lower, problem.max_intensity)
        light = problem.operator.forward(candidate)
        candidate_cost = -problem.likelihood.value(light)
        predicted = dot(gradient, image - candidate)
        if candidate_cost <= cost - _ARMIJO * predicted + _ROUNDING * abs(cost):
            return candidate, light, candidate_cost
    return None


def _pixels_with(problem: Problem, cells: Mask) -> Mask:
    """Return the mask of the pixels that cast light on any of the marked cells."""
    return np.asarray(problem.operator.adjoint(cells.astype(np.float64)) > 0)


def _trials(problem: Problem) -> Array:
    return np.broadcast_to(np.asarray(problem.likelihood.trials), problem.likelihood.shape)
