"""The problem of equation (4), built from data and a sensor, and solved for each gray image."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.estimators.convergence import ConvergenceHistory
from jotlight.estimators.inpaint import check_any_valid
from jotlight.estimators.mle import require_bits
from jotlight.sensing.bits import Bits
from jotlight.sensing.layout import Layout
from jotlight.sensing.likelihood import Likelihood, Problem
from jotlight.sensing.operators import scaling, spread
from jotlight.sensing.pixel_counts import (
    Data,
    Estimate,
    GrayData,
    PixelCounts,
    count_pixels,
    gray_images,
    prepare_data,
)
from jotlight.sensing.response import Array
from jotlight.sensing.sensor import Sensor

ConvergenceHistories = ConvergenceHistory | list[ConvergenceHistory]
"""The history of a gray image, or a list with that of each image of a stack and each channel."""

Solver = Callable[[Problem, Array | None, str], tuple[Array, ConvergenceHistory]]
"""A function that solves one problem. It takes the problem, its start, and a name for warnings."""


def solve_images(
    solve: Solver,
    data: Data | Problem,
    sensor: Sensor | None,
    trials: npt.ArrayLike | None,
    channel_axis: int | None,
    start: npt.ArrayLike | None,
    threads: int | None,
) -> tuple[Estimate, ConvergenceHistories]:
    """Return the solution and the history of a problem, or of each gray image of the data.

    Parameters
    ----------
    solve : callable
        The iterative method. The name of an only image is "".
    data : Bits, Merged, list of them, Problem, or array_like of int
        Bits, merged counts, counts (..., H, W), or a problem without a sensor.
    sensor : Sensor or None
        The sensor that recorded the data; None for a problem, and for data that carry it.
    trials : float or array_like of float, optional
        The number of trials of counts; None for a problem.
    channel_axis : int, optional
        The axis of counts that holds color channels; None for a problem.
    start : array_like of float, optional
        The initial image, of the shape of the estimate.
    threads : int, optional
        The number of threads. Default: all cores.

    Raises
    ------
    TypeError, ValueError
        When data, sensor and start do not fit together.
    """
    initial = None if start is None else _check_start(start)
    if isinstance(data, Problem):
        if sensor is not None:
            raise TypeError("sensor: expected none, since a Problem has its own operator")
        if trials is not None:
            raise TypeError("trials: expected none, since a Problem has its own likelihood")
        if channel_axis is not None:
            raise TypeError("channel_axis: expected none, since a Problem is one gray image")
        estimate, history = solve(data, _fit_start(initial, data), "")
        return estimate.astype(np.float32), history
    data, sensor = prepare_data(data, sensor, trials, channel_axis)
    images = gray_images(data)
    layout = images.layout
    starts: Any = [None] * len(images)
    if initial is not None:
        starts = layout.split(_check_axes(initial, layout))
    histories: list[ConvergenceHistory] = []

    def solve_image(image: GrayData) -> Estimate:
        problem = build_problem(image, sensor, threads)
        index = len(histories)
        name = "" if layout.is_single else f", {layout.name_of(index)}"
        estimate, history = solve(problem, _fit_start(starts[index], problem), name)
        histories.append(history)
        return estimate.astype(np.float32)

    result = images.map(solve_image)
    return result, histories[0] if layout.is_single else histories


def build_problem(data: GrayData, sensor: Sensor, threads: int | None) -> Problem:
    """Return the problem of one gray image of bits or counts: equation (4).

    With the box kernel the bits of a pixel are exchangeable. Their count is then a sufficient
    statistic, and the cells are the pixels. With a smooth kernel, or where the jots of a pixel
    differ, the cells are the jots.

    Parameters
    ----------
    data : Bits of shape (T, H·K̂, W·K̂), Merged, or ndarray of int32, both of shape (H, W)
        The bits, merged counts, or counts.
    sensor : Sensor
        The sensor that recorded them.
    threads : int, optional
        The number of threads. Default: all cores.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together, or no pixel has a valid bit.

    Examples
    --------
    >>> build_problem(np.array([[3, 1]], np.int32), Sensor(oversampling=2), None).likelihood.shape
    (1, 2)
    """
    recorded = data.sensor if isinstance(data, Bits) else None
    if recorded is not None and recorded.kernel != sensor.kernel:
        raise ValueError(
            f"kernel: expected {recorded.kernel!r}, the kernel of the bits' own sensor, got "
            f"{sensor.kernel!r}; Bits(bits.packed, bits.width) drops that sensor"
        )
    pixels = count_pixels(data, sensor, threads)
    check_any_valid(pixels.trials)
    if sensor.kernel == "box" and not pixels.varies_within_pixels:
        return _pixel_problem(pixels, threads)
    return _jot_problem(data, sensor, pixels.counts.shape, threads)


def _check_start(start: npt.ArrayLike) -> Array:
    array = np.asarray(start)
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
    if start is None:
        return None
    if start.shape != problem.operator.input_shape:
        raise ValueError(
            f"start: expected the image's shape {problem.operator.input_shape}, got {start.shape}"
        )
    return np.clip(start, 0, problem.max_intensity)


def _pixel_problem(pixels: PixelCounts, threads: int | None) -> Problem:
    _, light, max_intensity = pixels.sensor.pixel_response()
    likelihood = Likelihood(
        pixels.counts,
        pixels.trials,
        threshold=pixels.sensor.threshold,
        efficiency=pixels.efficiency,
        dark_counts=pixels.dark_counts,
        threads=threads,
    )
    return Problem(scaling(pixels.counts.shape, light), likelihood, max_intensity)


def _jot_problem(
    data: GrayData,
    sensor: Sensor,
    shape: tuple[int, ...],
    threads: int | None,
) -> Problem:
    if sensor.kernel == "box":
        bits = require_bits(data)
    else:
        bits = require_bits(data, f"the light of a {sensor.kernel} kernel differs from jot to jot")
    ones = bits.counts(1, mask=sensor.mask, threads=threads)
    trials: Any = sensor.frames
    if sensor.mask is not None:
        trials = np.where(sensor.mask, 0.0, float(sensor.frames))
    light = spread(
        shape,
        sensor.oversampling,
        sensor.kernel,
        gain=sensor.gain / sensor.frames,
        threads=threads,
    )
    likelihood = Likelihood(
        ones,
        trials,
        threshold=sensor.threshold,
        efficiency=sensor.efficiency,
        dark_counts=sensor.dark_counts,
        threads=threads,
    )
    return Problem(light, likelihood, sensor.max_intensity)
