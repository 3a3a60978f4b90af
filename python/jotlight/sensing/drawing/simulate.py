"""Simulation of a sensor from an image: checks, windows, and rates or probabilities of all jots.

The functions take the sensor as the dictionary that `Sensor.engine_arguments` returns.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_image, check_threads
from jotlight.chunks import frame_chunks
from jotlight.layout import Layout
from jotlight.sensing.bits.output_images import OutputImages, check_out
from jotlight.sensing.parameters.intensity_scale import warn_about_scale, warn_about_transparency
from jotlight.sensing.parameters.sensor_like import SensorLike
from jotlight.sensing.parameters.slices import require_slice

AnySensor = TypeVar("AnySensor", bound=SensorLike)
EngineSensor = dict[str, Any]
Ends = tuple[int, int]

JotFunction = Callable[
    [EngineSensor, npt.NDArray[Any], int, npt.NDArray[np.float32], int | None], None
]
"""A function of the engine that fills some rows of jots: `engine.rate` or `engine.probability`."""


class EnginePart(NamedTuple):
    """Readings with the same gain and threshold."""

    frames: npt.NDArray[np.intp] | None
    """The numbers of their frames, or None for all."""
    sensor: EngineSensor


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

    def parts(self, oversampling: int, bits: int) -> Iterator[tuple[Self, tuple[slice, slice]]]:
        """Yield parts to draw at once, with their frames and rows of jots in the output.

        A jot has `bits` bits in each frame.
        """
        row_bits = bits * len(self.columns) * oversampling**2
        for f, r in frame_chunks(len(self.frames), len(self.rows), row_bits):
            frames, rows = self.frames[f.start : f.stop], self.rows[r.start : r.stop]
            jots = slice(r.start * oversampling, r.stop * oversampling)
            part = dataclasses.replace(self, frames=frames, rows=rows)
            yield part, (slice(f.start, f.stop), jots)

    def bounds(self) -> tuple[Ends, Ends, Ends]:
        """Return the ends of the frames, the rows, and the columns."""
        frames, rows, columns = self.frames, self.rows, self.columns
        return (frames.start, frames.stop), (rows.start, rows.stop), (columns.start, columns.stop)

    def jot_slices(self, oversampling: int) -> tuple[slice, slice]:
        """Return the window's rows and columns of jots."""
        rows, columns = (
            slice(part.start * oversampling, part.stop * oversampling)
            for part in (self.rows, self.columns)
        )
        return rows, columns


def checked_images(
    sensor: SensorLike, image: npt.ArrayLike, channel_axis: int | None
) -> tuple[npt.NDArray[Any], Layout]:
    """Return images of intensities and their layout, after checks.

    With a mosaic, these are the intensities behind the filters.

    Raises
    ------
    TypeError
        For integers, whose scale is unknown.
    ValueError
        When the image is empty, negative, or not finite, its axes are not clear, or it does not fit
        the maps of the sensor.
    """
    pixels = as_image(image)
    if sensor.mosaic is not None:
        pixels, channel_axis = sensor.mosaic.light(pixels, channel_axis), None
    layout = Layout.of("image", pixels, channel_axis)
    sizes = layout.moved(pixels).shape[-2:]
    height, width = (size * sensor.oversampling for size in sizes)
    sensor.check_map_shapes(height, width)
    warn_about_scale("image", [pixels], sensor.max_intensity)
    if layout.channel_axis is not None:
        warn_about_transparency(np.moveaxis(pixels, layout.channel_axis, -1))
    return pixels, layout


def crop(sensor: AnySensor, window: Window, image_size: tuple[int, int]) -> AnySensor:
    """Return a sensor, cropped to a window of an image of size `image_size`."""
    frames = window.frames
    whole = len(frames) == sensor.frames
    cropped = sensor if whole else sensor.select_frames(slice(frames.start, frames.stop))
    if (len(window.rows), len(window.columns)) == image_size:
        return cropped
    jots = window.jot_slices(sensor.oversampling)
    maps = {name: map_[jots] for name, map_ in sensor.maps().items()}
    if sensor.mosaic is not None:
        maps["mosaic"] = sensor.mosaic.crop(window.rows, window.columns)
    return cropped.replace(**maps) if maps else cropped


def evaluate_on_jots(
    function: JotFunction,
    sensor: EngineSensor,
    image: npt.NDArray[Any],
    layout: Layout,
    out: npt.NDArray[np.float32] | None,
    threads: int | None,
) -> npt.NDArray[np.float32]:
    """Return the values of `function` on all jots of each image, in the layout of the images."""
    images = layout.split(image)
    output = OutputImages(layout, _jots_of(images, sensor), out, inputs=[image])
    for plane, jots in zip(images, output.images, strict=True):
        function(sensor, plane, 0, jots, threads)
    return output.finish(output.images)


def _jots_of(images: npt.NDArray[Any], sensor: EngineSensor) -> tuple[int, ...]:
    """Return the numbers of rows and columns of jots that see images (N, H, W)."""
    return tuple(size * sensor["oversampling"] for size in images.shape[1:])


def evaluate_parts(
    function: JotFunction,
    parts: list[EnginePart],
    image: npt.NDArray[Any],
    layout: Layout,
    out: npt.NDArray[np.float32] | None,
    threads: int | None,
) -> npt.NDArray[np.float32]:
    """Return :func:`evaluate_on_jots` of readings that may differ.

    If the frames differ, the first axis is that of the frames. The values of parts with the same
    frames are added: each is 0 for the jots of the others.
    """
    check_threads(threads)
    if len(parts) == 1:
        return evaluate_on_jots(function, parts[0].sensor, image, layout, out, threads)
    shape = layout.shape_of(_jots_of(layout.split(image), parts[0].sensor))
    if parts[0].frames is not None:
        shape = sum(len(frames) for frames in _distinct_frames(parts)), *shape
    total = np.empty(shape, np.float32) if out is None else check_out(out, shape, np.float32)
    if np.may_share_memory(total, image):
        image = image.copy()
    total[...] = 0
    for frames, sensor in parts:
        own = evaluate_on_jots(function, sensor, image, layout, None, threads)
        total[slice(None) if frames is None else frames] += own
    return total


def _distinct_frames(parts: list[EnginePart]) -> Iterator[npt.NDArray[np.intp]]:
    """Yield the frames of each group of parts with the same frames."""
    seen = set()
    for frames, _ in parts:
        if frames is not None and int(frames[0]) not in seen:
            seen.add(int(frames[0]))
            yield frames


def _as_range(name: str, part: slice, size: int) -> range:
    require_slice(name, part)
    chosen = range(size)[part]
    if chosen.step != 1 or len(chosen) == 0:
        raise ValueError(f"{name}: expected a slice with step 1 inside 0..{size}, got {part!r}")
    return chosen
