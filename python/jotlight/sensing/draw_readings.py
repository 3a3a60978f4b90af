"""Simulation of readings of several bits, and of bits with read noise."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.checks import check_threads
from jotlight.layout import Layout
from jotlight.seeds import seed_of_image
from jotlight.sensing.simulate import EnginePart, EngineSensor, Window, frame_runs


def draw_readings(
    parts: list[EnginePart],
    pixels: npt.NDArray[Any],
    layout: Layout,
    seed: bytes,
    window: Window,
    threads: int | None,
    progress: Callable[[float], object] | None,
) -> list[npt.NDArray[np.uint16]]:
    """Return the readings of a window of each image of a stack, or of a single image.

    The parameters are those of :func:`jotlight.sensing.simulate.draw_stack`. The shape of the
    result is (frames, rows, columns), or (frames, rows, columns, C) for color.
    """
    check_threads(threads)
    oversampling = parts[0].sensor["oversampling"]
    is_color = layout.channel_axis is not None
    stack = layout.shape[:-1] if is_color else layout.shape
    number = int(np.prod(stack, dtype=int))
    images = layout.split(pixels)
    images = images.reshape(number, -1, *images.shape[1:])
    sizes = (len(window.rows) * oversampling, len(window.columns) * oversampling)
    out = np.zeros((number, images.shape[1], len(window.frames), *sizes), np.uint16)
    seeds = [seed_of_image(seed, index) for index in range(number)]
    runs = [
        (run, sensor)
        for frames, sensor in parts
        for run in frame_runs(frames, window.frames, len(window.frames))
    ]
    for index, (run, sensor) in enumerate(runs):
        start = run.start - window.frames.start
        place = out[:, :, start : start + len(run)]
        own = dataclasses.replace(window, frames=run)
        # A jot reports 0 in all parts but its own, because their sensors mask it.
        shared = len(runs) > 1 and parts[0].frames is None
        target = np.zeros(place.shape, np.uint16) if shared else place
        _draw(sensor, images, seeds, own, target, threads)
        if shared:
            place += target
        if progress:
            progress((index + 1) / len(runs))
    readings = list(np.moveaxis(out, 1, -1) if is_color else out[:, 0])
    return [np.ascontiguousarray(each) for each in readings]


def _draw(
    sensor: EngineSensor,
    images: npt.NDArray[Any],
    seeds: list[bytes],
    window: Window,
    out: npt.NDArray[np.uint16],
    threads: int | None,
) -> None:
    """Draw the readings of a window of each image into `out` (N, C, frames, rows, columns)."""
    # A reading takes as much memory as 16 bits.
    parts = list(window.parts(sensor["oversampling"], 16 * len(seeds)))
    for channel in range(images.shape[1]):
        streams = [(seed, channel) for seed in seeds]
        for part, place in parts:
            engine.draw_readings(
                sensor,
                sensor["response"],
                images[:, channel],
                streams,
                *part.bounds(),
                out[:, channel, *place],
                threads,
            )


def noisy_probability(
    sensor: EngineSensor,
    image: npt.NDArray[Any],
    first: int,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None:
    """Write P(b = 1) of bits with read noise, as `engine.probability` does without it."""
    engine.rate(sensor, image, first, out, threads)
    rates = np.ascontiguousarray(out.reshape(-1), np.float64)
    logarithms = np.empty(rates.size)
    ones = np.ones(rates.size, np.int32)
    engine.readings_log_probability(sensor["response"], ones, rates, logarithms, threads)
    out[:] = np.exp(logarithms).reshape(out.shape)
    if sensor["dead"] is not None:
        out[sensor["dead"][first : first + len(out)]] = 0
