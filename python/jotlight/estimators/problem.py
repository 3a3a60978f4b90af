"""From data and a sensor to what is to be maximised."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.estimators.convergence import ConvergenceHistory
from jotlight.sensing.bits import Bits
from jotlight.sensing.likelihood import Array, Likelihood, Problem
from jotlight.sensing.operators import scaling, spread
from jotlight.sensing.pixel_counts import (
    Estimate,
    PixelCounts,
    carried_sensor,
    count_pixels,
    map_channels,
)
from jotlight.sensing.sensor import Sensor

ConvergenceHistories = ConvergenceHistory | list[ConvergenceHistory]
"""Of one channel, or of each channel of a colour image."""


def solve_channels(
    solve: Callable[[Problem, Array | None, str], tuple[Array, ConvergenceHistory]],
    data: Bits | Problem | npt.ArrayLike,
    sensor: Sensor | None,
    start: npt.ArrayLike | None,
    threads: int | None,
) -> tuple[Estimate, ConvergenceHistories]:
    """Solve a problem, or that of each channel of data, from the start that belongs to it.

    `solve` takes the problem, the start, and words that tell which channel it is, where there are
    several.

    Raises
    ------
    TypeError, ValueError
        When data, sensor and start do not fit.
    """
    begin = None if start is None else _checked_start(start)
    if isinstance(data, Problem):
        if sensor is not None:
            raise TypeError("sensor: expected none, since a Problem has its own operator")
        estimate, history = solve(data, _fitting_start(begin, data), "")
        return estimate.astype(np.float32), history
    if not isinstance(sensor, Sensor):
        raise TypeError(f"sensor: expected a jotlight.Sensor, got {type(sensor).__name__}")
    channels = data.shape[3:] if isinstance(data, Bits) else np.shape(data)[2:]
    if begin is not None and begin.shape[2:] != channels:
        raise ValueError(
            f"start: expected (H, W) and as many channels as the data {tuple(channels)}, "
            f"got shape {begin.shape}"
        )
    histories: list[ConvergenceHistory] = []

    def one_channel(channel: Bits | npt.NDArray[np.int32]) -> Estimate:
        problem = build_problem(channel, sensor, threads)
        own = begin if begin is None or begin.ndim == 2 else begin[..., len(histories)]
        words = f", channel {len(histories)}" if channels else ""
        estimate, history = solve(problem, _fitting_start(own, problem), words)
        histories.append(history)
        return estimate.astype(np.float32)

    picture = map_channels(one_channel, data)
    return picture, histories if channels else histories[0]


def _checked_start(start: npt.ArrayLike) -> Array:
    array = np.asarray(start)
    if array.dtype.kind != "f":
        raise TypeError(f"start: expected floats in units of intensity, got {array.dtype}")
    if not np.isfinite(array).all():
        raise ValueError("start: expected finite intensities, got NaN or infinity")
    return array.astype(np.float64)


def _fitting_start(start: Array | None, problem: Problem) -> Array | None:
    if start is None:
        return None
    if start.shape != problem.operator.input_shape:
        raise ValueError(
            f"start: expected the picture's shape {problem.operator.input_shape}, got {start.shape}"
        )
    return np.clip(start, 0, problem.max_intensity)


def build_problem(
    data: Bits | npt.NDArray[np.int32], sensor: Sensor, threads: int | None
) -> Problem:
    """Give the problem of one channel's bits or counts.

    With the box kernel a pixel's bits are exchangeable and their count says all: the cells are the
    pixels. Where they are not, for a smooth kernel or jots that differ inside of a pixel, the cells
    are the jots.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit.
    """
    carried = carried_sensor(data)
    if carried is not None and carried.kernel != sensor.kernel:
        raise ValueError(
            f"kernel: expected {carried.kernel!r}, with which the bits were made, got "
            f"{sensor.kernel!r}; Bits(bits.packed, bits.width) takes away what they know of it"
        )
    seen = count_pixels(data, sensor, threads)
    if np.max(seen.trials) == 0:
        raise ValueError("mask: expected at least one jot that is alive, got none")
    if sensor.kernel == "box" and not seen.varies_within_pixels:
        return _of_pixels(seen, threads)
    return _of_jots(data, sensor, seen.counts.shape, threads)


def _of_pixels(seen: PixelCounts, threads: int | None) -> Problem:
    _, light, most = seen.sensor.pixel_response()
    likelihood = Likelihood(
        seen.counts,
        seen.trials,
        threshold=seen.sensor.threshold,
        efficiency=seen.efficiency,
        dark_counts=seen.dark_counts,
        threads=threads,
    )
    return Problem(scaling(seen.counts.shape, light), likelihood, most)


def _of_jots(
    data: Bits | npt.NDArray[np.int32],
    sensor: Sensor,
    shape: tuple[int, ...],
    threads: int | None,
) -> Problem:
    if not isinstance(data, Bits):
        why = (
            "jots of one pixel differ in their efficiency or dark counts"
            if sensor.kernel == "box"
            else f"the light of a {sensor.kernel} kernel differs from jot to jot"
        )
        raise ValueError(
            f"counts: where {why} the bits are needed, since a count does not tell which jots fired"
        )
    ones = data.counts(1, mask=sensor.mask, threads=threads)
    trials: Any = sensor.frames
    if sensor.mask is not None:
        trials = np.where(sensor.mask, np.int32(0), np.int32(sensor.frames))
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
