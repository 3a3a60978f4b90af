"""The solutions of an iterative method for the gray images of some data, or for a problem."""

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.checks import to_array
from jotlight.estimators.iterative.convergence import ConvergenceHistories, ConvergenceMonitor
from jotlight.estimators.iterative.problem_building import build_problem
from jotlight.layout import Layout
from jotlight.sensing.bits.output_images import OutputImages
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import Data, gray_images, prepare_data
from jotlight.sensing.likelihood.problem import Problem
from jotlight.sensing.sensor import Sensor
from jotlight.underflow import underflows_to_0

Solver = Callable[[Problem, Array | None], Array]
"""A function that returns the images of the problem of a stack, from their initial images."""

_MAX_CELLS = 1 << 17
"""Maximum number of cells of the images that a method iterates at the same time, if they are
several. More do not fit into the caches."""


@dataclasses.dataclass(frozen=True)
class SolverInputs:
    """What an iterative method gets from its caller."""

    data: Data | Problem
    """Bits, merged counts, counts (..., H, W), a list of them, or a problem without a sensor."""
    sensor: Sensor | None = None
    """The sensor of the data; None for a problem, and for data that carry it."""
    trials: npt.ArrayLike | None = None
    """The number of trials of counts; None for a problem."""
    channel_axis: int | None = None
    """The axis of counts that holds color channels; None for a problem."""
    start: npt.ArrayLike | None = None
    """The initial image, of the shape of the estimate."""
    out: npt.NDArray[np.float32] | None = None
    """The array for the estimate."""
    threads: int | None = None
    """The number of threads. Default: the number of cores."""


@underflows_to_0
def solve_images(
    solve: Solver, monitor: ConvergenceMonitor, inputs: SolverInputs
) -> tuple[Image, ConvergenceHistories]:
    """Return the solution and the history of a problem, or of each gray image of the data.

    Parameters
    ----------
    solve : callable
        The iterative method, which solves the problems of several images at once.
    monitor : ConvergenceMonitor
        The monitor to which the method reports.
    inputs : SolverInputs
        The data, and how to read and to return them.

    Raises
    ------
    TypeError, ValueError
        When data, sensor, start and out do not fit together.

    Warns
    -----
    JotlightWarning
        Once, when images did not converge.
    """
    data, out = inputs.data, inputs.out
    initial = None if inputs.start is None else _check_start(inputs.start)
    if isinstance(data, Problem):
        _refuse_options(inputs)
        if initial is not None and not data.is_stack:
            initial = initial[None]
        problem = data.stacked()
        layout = Layout((len(problem.likelihood.ones),) if data.is_stack else ())
        output = OutputImages(layout, problem.operator.input_shape, out)
        estimate = solve(problem, _fit_start(initial, problem)).astype(np.float32)
    else:
        data, sensor = prepare_data(data, inputs.sensor, inputs.trials, inputs.channel_axis)
        images = gray_images(data)
        layout, output = images.layout, output_of(images, sensor, out)
        starts = None if initial is None else layout.split(_check_axes(initial, layout))
        estimate, first = output.images, 0
        for part in images.parts(sensor, _max_pixels(sensor)):
            problem = build_problem(part, sensor, inputs.threads)
            places = slice(first, first + len(part))
            own = None if starts is None else starts[places]
            estimate[places] = solve(problem, _fit_start(own, problem))
            first += len(part)
    monitor.warn(lambda index: "" if layout.is_single else layout.name_of(index))
    histories = monitor.histories
    return output.finish(estimate), histories[0] if layout.is_single else histories


def _max_pixels(sensor: Sensor) -> int:
    """Return the maximum number of pixels of several images that are solved at once."""
    uses_jots = sensor.kernel != "box"
    return _MAX_CELLS // (sensor.oversampling**2 if uses_jots else 1)


def _refuse_options(inputs: SolverInputs) -> None:
    """Raise TypeError for options of data that a problem does not have."""
    if inputs.sensor is not None:
        raise TypeError("sensor: expected none, since a Problem has its own operator")
    if inputs.trials is not None:
        raise TypeError("trials: expected none, since a Problem has its own likelihood")
    if inputs.channel_axis is not None:
        raise TypeError("channel_axis: expected none, since a Problem has no channels")


def _check_start(start: npt.ArrayLike) -> Array:
    array = to_array("start", start)
    if array.dtype.kind != "f":
        raise TypeError(f"start: expected floats in units of intensity, got {array.dtype}")
    if not np.isfinite(array).all():
        raise ValueError("start: expected finite intensities, got NaN or infinity")
    return array.astype(np.float64)


def _check_axes(start: Array, layout: Layout) -> Array:
    """Return the initial images, whose axes must be those of the estimate."""
    if start.ndim != 2 + len(layout.shape) or layout.moved(start).shape[:-2] != layout.shape:
        raise ValueError(
            f"start: expected the axes of the estimate, (H, W) and {layout.shape} for a stack and "
            f"channels, got shape {start.shape}"
        )
    return start


def _fit_start(start: Array | None, problem: Problem) -> Array | None:
    """Return the initial images, (N, ...), clipped to [0, S]."""
    if start is None:
        return None
    if start.shape[1:] != problem.operator.input_shape:
        raise ValueError(
            f"start: expected the image's shape {problem.operator.input_shape}, "
            f"got {start.shape[1:]}"
        )
    if len(start) != len(problem.likelihood.ones):
        raise ValueError(f"start: expected {len(problem.likelihood.ones)} images, got {len(start)}")
    return np.clip(start, 0, problem.max_intensity)
