"""Maximum likelihood with total variation, by ADMM: the paper's reference [7]."""

from __future__ import annotations

from typing import Literal, overload

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.estimators.iterative.admm_splitting import BALANCE, Splitting
from jotlight.estimators.iterative.convergence import (
    ConvergenceHistories,
    ConvergenceMonitor,
    IterationCallback,
)
from jotlight.estimators.iterative.image_solver import SolverInputs, solve_images
from jotlight.estimators.tv import automatic_weight, check_map, check_norm, total_variations
from jotlight.sensing.data.pixel_counts import Data
from jotlight.sensing.data.stacks import select
from jotlight.sensing.likelihood.problem import Problem
from jotlight.sensing.sensor import Sensor

_MIN_LIGHT = 1e-6
"""The light that replaces a light of 0 where a bit is 1, as a fraction of the maximum light."""


@overload
def admm_tv(
    data: Data | Problem,
    sensor: Sensor | None = None,
    *,
    weight: float | npt.ArrayLike | None = ...,
    norm: str = ...,
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
def admm_tv(
    data: Data | Problem,
    sensor: Sensor | None = None,
    *,
    weight: float | npt.ArrayLike | None = ...,
    norm: str = ...,
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
def admm_tv(
    data: Data | Problem,
    sensor: Sensor | None = None,
    *,
    weight: float | npt.ArrayLike | None = None,
    norm: str = "isotropic",
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    start: npt.ArrayLike | None = None,
    max_iter: int = 500,
    tol: float = 1e-3,
    callback: IterationCallback | None = None,
    return_history: bool = False,
    out: npt.NDArray[np.float32] | None = None,
    threads: int | None = None,
) -> Image | tuple[Image, ConvergenceHistories]:
    """Return the image c that minimizes -ℓ(c) + λ TV(c) over [0, S].

    Parameters
    ----------
    data : Bits, Merged, list of them, array_like of int, or Problem
        Bits; or merged counts, or counts L of shape (..., H, W), which suffice for the box kernel,
        and counts also for other kernels if a pixel is a jot; or a custom problem without a sensor,
        for signals (N,) and other operators. Each image of a stack stops by itself.
    sensor : Sensor, optional
        The sensor that recorded the data. Default: the one that bits or merged counts carry.
    weight : float or array_like of float, optional
        λ ≥ 0 in nats per unit of intensity: a number, or a map with one value for each pixel.
        Default: :func:`jotlight.estimators.tv.automatic_weight` chooses it from the data.
    norm : {"isotropic", "anisotropic"}
        TV sums √(down² + right²) over the pixels, or abs(down) + abs(right).
    trials : float or array_like of float, optional
        The number of binary readings behind each pixel of counts, 0 or more: a number, or a map of
        their shape. Default: the sensor's K.
    channel_axis : int, optional
        The axis of counts that holds color channels. Default: none, and axes before the last two
        are those of a stack.
    start : array_like of float, optional
        The initial image, of the shape of the estimate. A start near the solution saves
        iterations. Default: the same intensity everywhere.
    max_iter : int
        The maximum number of iterations, at least 1.
    tol : float
        The run ends when the primal residual is at most `tol` and the dual residual at most
        10 `tol`. Both residuals are relative. Where nearly all bits are 1, they are small before
        the image is near the solution: take 1e-5 and more iterations for such scenes.
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
        When the run did not converge.

    Notes
    -----
    The alternating direction method of multipliers splits A c = x, D c = v and, where the cells
    are jots, c = w in [0, S] (Chan and Lu 2014). The residuals and the stopping rule follow Boyd et
    al. (2011), section 3.3. The adjustment of the penalties follows Wohlberg (2017). The step in x
    solves a scalar problem for each cell. The step in v is a shrinkage. The step in c is diagonal
    in the cosine basis. It requires a few steps of conjugate gradients only if K̂ and the degree of
    the kernel are both odd.

    Total variation alone determines the pixels without a valid bit.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=4)
    >>> image = np.where(np.arange(32)[:, None] < 16, 0.2, 0.7) * np.ones((32, 32))
    >>> bits = sensor.expose(image, rng=0)
    >>> estimate, history = jl.admm_tv(bits, sensor, return_history=True)
    >>> history.converged, bool(abs(estimate - image).mean() < 0.05)
    (True, True)
    """
    check_norm(norm)
    if weight is not None:
        check_map("weight", weight, np.shape(weight))
    monitor = ConvergenceMonitor("admm_tv", max_iter, tol, callback)

    def solve(problem: Problem, start: Array | None) -> Array:
        own = automatic_weight(problem, norm=norm) if weight is None else _weights(weight, problem)
        return _minimize(problem, own, norm, start, monitor, threads)

    inputs = SolverInputs(data, sensor, trials, channel_axis, start, out, threads)
    estimate, history = solve_images(solve, monitor, inputs)
    return (estimate, history) if return_history else estimate


def _weights(weight: float | npt.ArrayLike, problem: Problem) -> float | Array:
    """Return the weight of all pixels, or a map of it for each image of a stack."""
    shape = problem.operator.input_shape
    checked = check_map("weight", weight, shape)
    if not isinstance(checked, np.ndarray):
        return checked
    return np.repeat(checked.reshape(1, *shape), len(problem.likelihood.ones), axis=0)


def _minimize(
    problem: Problem,
    weight: float | Array,
    norm: str,
    start: Array | None,
    monitor: ConvergenceMonitor,
    threads: int | None,
) -> Array:
    """Return the images of a stack. The monitor records their histories."""
    splitting = Splitting(problem, weight, norm, start, monitor.tol, threads)
    results = np.empty((len(problem.likelihood.ones), *problem.operator.input_shape))
    monitor.begin(len(results))
    while True:
        primal, dual = splitting.step()
        estimate, active = splitting.estimates(), monitor.active
        residuals = {"primal": primal, "dual": dual}
        unfinished = monitor.update(estimate, residuals, {"dual": 1 / BALANCE})
        if not unfinished.all():
            results[active[~unfinished]] = estimate[~unfinished]
            if not unfinished.any():
                break
            splitting.select(unfinished)
            primal, dual = select(primal, unfinished), select(dual, unfinished)
        splitting.balance(monitor.number, primal, dual)
    objectives = total_variations(results, norm, weight, threads)
    objectives -= _finite_log_likelihoods(problem, results, _MIN_LIGHT * splitting.max_light)
    monitor.finish(objectives, weight)
    return results


def _finite_log_likelihoods(problem: Problem, images: Array, min_light: float) -> Array:
    """Return ℓ of each image, finite even if rounding leaves a bit of 1 without light."""
    light = problem.operator.forward(images)
    values = problem.likelihood.values(light)
    if np.isfinite(values).all():
        return values
    return np.where(
        np.isfinite(values), values, problem.likelihood.values(np.maximum(light, min_light))
    )
