"""Simulation of readings of several bits, and of bits with read noise."""

from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.checks import check_threads
from jotlight.sensing.drawing.draws import Draw
from jotlight.sensing.drawing.simulate import EngineSensor, Window
from jotlight.underflow import underflows_to_0


def draw_readings(draw: Draw) -> list[npt.NDArray[np.uint16]]:
    """Return the readings of each image, (frames, rows, columns), or (frames, rows, columns, C)."""
    check_threads(draw.threads)
    images, window = draw.images, draw.window
    sizes = (len(window.rows) * draw.oversampling, len(window.columns) * draw.oversampling)
    out = np.zeros((*images.shape[:2], len(window.frames), *sizes), np.uint16)
    runs = draw.runs(len(window.frames))
    for index, (sensor, own, frames) in enumerate(runs):
        place = out[:, :, frames]
        # A jot reports 0 in all parts but its own, because their sensors mask it. A part without
        # masked jots shares its frames with no other part.
        shared = len(runs) > 1 and sensor["dead"] is not None
        target = np.zeros(place.shape, np.uint16) if shared else place
        _draw_part(draw, sensor, own, target)
        if shared:
            place += target
        draw.progress((index + 1) / len(runs))
    readings = list(np.moveaxis(out, 1, -1) if draw.is_color else out[:, 0])
    return [np.ascontiguousarray(each) for each in readings]


def _draw_part(
    draw: Draw, sensor: EngineSensor, window: Window, out: npt.NDArray[np.uint16]
) -> None:
    """Draw the readings of a part in a window into `out`, (N, C, frames, rows, columns)."""
    # A reading takes as much memory as 16 bits.
    pieces = list(window.parts(draw.oversampling, 16 * len(draw.seeds)))
    for channel in range(draw.images.shape[1]):
        streams = [(seed, channel) for seed in draw.seeds]
        for piece, place in pieces:
            engine.draw_readings(
                sensor,
                sensor["response"],
                draw.images[:, channel],
                streams,
                *piece.bounds(),
                out[:, channel, *place],
                draw.threads,
            )


@underflows_to_0
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
