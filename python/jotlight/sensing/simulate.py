"""Simulation of a sensor from an image: random bits, and rates or probabilities of all jots.

The functions take the sensor as the dictionary that `Sensor.engine_arguments` returns.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.chunks import frame_chunks
from jotlight.sensing.channels import channel_views

EngineSensor = dict[str, Any]
JotFunction = Callable[
    [EngineSensor, npt.NDArray[Any], int, npt.NDArray[np.float32], int | None], None
]
"""A function of the engine that fills some rows of jots: `engine.rate` or `engine.probability`."""


@dataclasses.dataclass(frozen=True)
class Window:
    """The part of an exposure that is simulated: frames, and rows and columns of pixels."""

    frames: range
    rows: range
    columns: range

    @classmethod
    def from_slices(
        cls,
        image_size: tuple[int, int],
        number_of_frames: int,
        tile: tuple[slice, slice] | None,
        frames: slice | None,
    ) -> Self:
        """Return the window of a tile and a range of frames; None stands for all.

        Raises
        ------
        TypeError, ValueError
            When an argument is not a slice, or a slice selects nothing or has a step.
        """
        if tile is None:
            tile = (slice(None), slice(None))
        elif len(tile) != 2:
            raise ValueError(f"tile: expected slices of rows and columns, got {tile!r}")
        rows = _as_range("tile rows", tile[0], image_size[0])
        columns = _as_range("tile columns", tile[1], image_size[1])
        chosen = _as_range("frames", slice(None) if frames is None else frames, number_of_frames)
        return cls(chosen, rows, columns)

    def packed_shape(self, oversampling: int) -> tuple[int, int, int]:
        """Return the shape of the window's packed bits, for one channel."""
        return (
            len(self.frames),
            len(self.rows) * oversampling,
            math.ceil(len(self.columns) * oversampling / 8),
        )

    def jot_slices(self, oversampling: int) -> tuple[slice, slice]:
        """Return the window's rows and columns of jots."""
        rows, columns = (
            slice(part.start * oversampling, part.stop * oversampling)
            for part in (self.rows, self.columns)
        )
        return rows, columns


def packed_output(
    shape: tuple[int, ...], out: npt.NDArray[np.uint8] | None
) -> npt.NDArray[np.uint8]:
    """Return `out`, after checking its type and shape, or a new array.

    Raises
    ------
    ValueError
        When `out` cannot hold packed bits of this shape.
    """
    if out is None:
        return np.empty(shape, np.uint8)
    if out.dtype != np.uint8 or out.shape != shape or not out.flags.writeable:
        raise ValueError(
            f"out: expected a writeable uint8 array of shape {shape}, "
            f"got {out.dtype} of shape {out.shape}"
        )
    return out


def draw_bits(
    sensor: EngineSensor,
    image: npt.NDArray[Any],
    seed: bytes,
    window: Window,
    out: npt.NDArray[np.uint8],
    threads: int | None,
    progress: Callable[[float], object] | None,
) -> None:
    """Draw the packed bits of a window of an image, (H, W) or (H, W, C), into `out`."""
    oversampling = sensor["oversampling"]
    frames, rows, columns = window.frames, window.rows, window.columns
    channels = list(zip(channel_views(image), channel_views(out, 3), strict=True))
    chunks = list(frame_chunks(len(frames), len(rows), len(columns) * oversampling**2))
    for channel, (plane, packed) in enumerate(channels):
        for index, (f, r) in enumerate(chunks):
            part = packed[f.start : f.stop, r.start * oversampling : r.stop * oversampling]
            engine.expose(
                sensor,
                plane,
                seed,
                channel,
                (frames.start + f.start, frames.start + f.stop),
                (rows.start + r.start, rows.start + r.stop),
                (columns.start, columns.stop),
                part,
                threads,
            )
            if progress:
                progress((channel + (index + 1) / len(chunks)) / len(channels))


def evaluate_on_jots(
    function: JotFunction, sensor: EngineSensor, image: npt.NDArray[Any], threads: int | None
) -> npt.NDArray[np.float32]:
    """Return the values of `function` on all jots, (H * K̂, W * K̂) or (H * K̂, W * K̂, C)."""
    height, width = (size * sensor["oversampling"] for size in image.shape[:2])
    out = np.empty((height, width, *image.shape[2:]), np.float32)
    for plane, jots in zip(channel_views(image), channel_views(out), strict=True):
        function(sensor, plane, 0, jots, threads)
    return out


def _as_range(name: str, part: slice, size: int) -> range:
    if not isinstance(part, slice):
        raise TypeError(f"{name}: expected a slice, got {part!r}")
    chosen = range(size)[part]
    if chosen.step != 1 or len(chosen) == 0:
        raise ValueError(f"{name}: expected a slice with step 1 inside 0..{size}, got {part!r}")
    return chosen
