"""Simulation of bits."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.checks import check_threads
from jotlight.sensing.bits.output_images import check_out
from jotlight.sensing.drawing.draws import Draw
from jotlight.sensing.drawing.simulate import EngineSensor, Window

_MAX_JOTS = 1 << 26
"""Maximum number of jots that are drawn at once for one of several parts."""


def draw_bits(draw: Draw, out: npt.NDArray[np.uint8] | None) -> list[npt.NDArray[np.uint8]]:
    """Return the packed bits of each image, (frames, rows, bytes), or (frames, rows, bytes, C).

    Raises
    ------
    TypeError, ValueError
        When `out` cannot hold them.
    """
    stack, channels = draw.stack, draw.layout.shape[-1:] if draw.is_color else ()
    shape = (*draw.window.packed_shape(draw.oversampling), *channels)
    whole = (*stack, *shape)
    packed = np.empty(whole, np.uint8) if out is None else check_out(out, whole, np.uint8)
    if len(stack) > 1 and not packed.flags.c_contiguous:
        raise ValueError("out: expected an array in C order for a stack of several axes")
    drawn = packed if len(stack) == 1 else packed.reshape(len(draw.seeds), *shape)
    _draw_parts(draw, np.moveaxis(drawn, -1, 1) if draw.is_color else drawn[:, None])
    return list(drawn) if stack else [packed]


def _draw_parts(draw: Draw, out: npt.NDArray[np.uint8]) -> None:
    """Draw the packed bits of all parts into `out`, (N, C, frames, rows, bytes).

    A jot reports 0 in all parts but its own, because their sensors mask it. So the bits of parts
    with the same frames are combined by OR. The random numbers depend on the positions alone.
    """
    check_threads(draw.threads)
    if len(draw.parts) == 1:
        _draw_part(draw, draw.parts[0].sensor, draw.window, out, draw.progress)
        return
    out[:] = 0
    jots = len(draw.seeds) * out.shape[3] * out.shape[4] * 8
    runs = draw.runs(max(1, _MAX_JOTS // jots))
    for index, (sensor, window, place) in enumerate(runs):
        drawn = np.empty((*out.shape[:2], len(window.frames), *out.shape[3:]), np.uint8)
        _draw_part(draw, sensor, window, drawn, lambda fraction: None)
        out[:, :, place] |= drawn
        draw.progress((index + 1) / len(runs))


def _draw_part(
    draw: Draw,
    sensor: EngineSensor,
    window: Window,
    out: npt.NDArray[np.uint8],
    progress: Callable[[float], object],
) -> None:
    """Draw the packed bits of a part in a window. The images of `out` may be strided."""
    pieces, channels = list(window.parts(draw.oversampling, len(draw.seeds))), draw.images.shape[1]
    for channel in range(channels):
        images, streams = draw.images[:, channel], [(seed, channel) for seed in draw.seeds]
        for index, (piece, place) in enumerate(pieces):
            target = out[:, channel, *place]
            engine.expose(sensor, images, streams, *piece.bounds(), target, draw.threads)
            progress((channel + (index + 1) / len(pieces)) / channels)
