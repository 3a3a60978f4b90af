"""Motion behind a pattern of the jots, from sums over squares of them.

The filters of a mosaic and the thresholds of a map stand still, and the scene moves over them. In
sums over a period of the pattern, it is gone, and in sums over squares of a random pattern, it is
nearly gone. So the motion of the sums is that of the scene.
"""

import math
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Pattern
from jotlight.formats.capture import CountStack, jot_shape
from jotlight.motion.motion import Motion
from jotlight.motion.tiles import TILE, tile_centers
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames, read_frames
from jotlight.sensing.parameters.maps import constant_or_map
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.response import (
    detection_probability,
    inverse_detection_probability,
)
from jotlight.sensing.sensor import Sensor
from jotlight.squares import mean_squares, repeat_squares

UnsignedCounts = npt.NDArray[np.uint8] | npt.NDArray[np.uint16] | npt.NDArray[np.uint32]

_MAX_SIDE = 8
"""Largest side of a square of pixels. Longer periods have parts with nearly the same filters."""

_USUAL_SIDE = 4
"""Side of a square of pixels for patterns with a longer period, and for maps."""

_MAX_BYTES = 1 << 28
"""Maximum number of bytes of sums that are kept. More are computed when they are needed."""

_FRAMES = 64
"""Number of frames that are unpacked at a time."""

_MIN_JOTS = 0.5
"""Fraction of the jots of a square that must be good."""


def squares_side(sensor: Sensor) -> int:
    """Return the side in jots of squares that hide the pattern of a sensor.

    It is the period of the mosaic, or of the map of thresholds, if it is short.

    Examples
    --------
    >>> sensors = jl.Sensor(mosaic="RGGB"), jl.Sensor(mosaic="RGB", oversampling=2)
    >>> tuple(squares_side(sensor) for sensor in sensors)
    (2, 6)
    >>> squares_side(jl.Sensor(threshold=1 + np.indices((64, 64)).sum(axis=0) % 3))
    3
    """
    if sensor.mosaic is None:
        thresholds = np.asarray(sensor.threshold)
        side, unit = math.lcm(_period(thresholds), _period(thresholds.T)), 1
    else:
        side, unit = math.lcm(*sensor.mosaic.pattern.shape), sensor.oversampling
    return unit * (side if side <= _MAX_SIDE else _USUAL_SIDE)


def _period(rows: npt.NDArray[np.integer]) -> int:
    """Return the number of rows after which an array repeats, or more than the largest side."""
    for period in range(1, min(_MAX_SIDE, len(rows) - 1) + 1):
        if (rows[period:] == rows[:-period]).all():
            return period
    return _MAX_SIDE + 1


class JotSquares:
    """Sums over squares of the jots of a sensor with a mosaic, or with a map of thresholds.

    Rows and columns of jots beyond the last whole square are left out.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    size : (int, int)
        H and W in jots.
    excluded : ndarray of bool, shape (H, W), optional
        The jots that are not counted. Default: none.
    trials : int
        The number of binary readings behind a count of a jot in one frame. Default: 1, for bits.

    Raises
    ------
    ValueError
        When the image is smaller than a square.
    """

    def __init__(
        self,
        sensor: Sensor,
        size: tuple[int, int],
        excluded: npt.NDArray[np.bool_] | None,
        trials: int = 1,
    ) -> None:
        self.side = squares_side(sensor)
        self.size = size[0] // self.side, size[1] // self.side
        """Rows and columns of squares."""
        if 0 in self.size:
            raise ValueError(
                f"data: expected {self.side} x {self.side} jots or more to find a motion behind "
                f"this pattern of the jots, got {size[0]} x {size[1]}"
            )
        self._sensor, self._trials = sensor, trials
        self._good = np.ones(size, np.uint8)
        if excluded is not None:
            self._good -= excluded

    def count(
        self, data: Bits | CountStack, start: int = 0, stop: int | None = None
    ) -> UnsignedCounts:
        """Return the sums in each of some frames, (n, rows, columns)."""
        stop = len(data) if stop is None else stop
        dtype = np.min_scalar_type(self.side**2 * self._trials)
        sums: UnsignedCounts = np.empty((max(0, stop - start), *self.size), dtype)
        rows, columns = (self.side * number for number in self.size)
        for first in range(start, stop, _FRAMES):
            last = min(first + _FRAMES, stop)
            each = _counts_of_jots(data, first, last) * self._good
            each = each[:, :rows, :columns].reshape(len(each), self.size[0], self.side, columns)
            of_rows = each.sum(axis=2, dtype=dtype)
            of_rows = of_rows.reshape(len(each), *self.size, self.side)
            of_rows.sum(axis=3, dtype=dtype, out=sums[first - start : last - start])
        return sums

    def stack(self, images: UnsignedCounts | Frames) -> CountStack:
        """Return the sums in T frames, (T, rows, columns), as counts."""
        provenance = Provenance("bits", "sums over squares of jots")
        return CountStack(images, provenance, trials=self.side**2 * self._trials)

    def sensor(self, frames: int) -> Sensor:
        """Return the gray sensor that counts the squares in some frames."""
        return _sensor_of_squares(self._sensor, self._good, frames * self._trials, self.side)


def _counts_of_jots(data: Bits | CountStack, start: int, stop: int) -> UnsignedCounts:
    """Return the bits or counts of some frames as numbers, (n, H, W)."""
    if isinstance(data, Bits):
        packed = read_frames(data.packed, start, stop)
        return np.unpackbits(packed, axis=2, count=data.width)
    images: UnsignedCounts = np.asarray(data.images[start:stop])
    data.check_range(images)
    return images


def trials_of_frame(data: Bits | CountStack) -> int:
    """Return the number of binary readings behind a count of a jot in one frame, 1 for bits."""
    return 1 if isinstance(data, Bits) or data.trials is None else data.trials


def in_squares(
    data: Bits | CountStack, sensor: Sensor, excluded: npt.NDArray[np.bool_] | None
) -> tuple[CountStack, Sensor]:
    """Return the counts of squares of jots in each frame, and a gray sensor whose jots they are.

    Parameters
    ----------
    data : Bits or CountStack
        T frames (T, H, W) of bits, or of counts that state their trials.
    sensor : Sensor
        Their sensor, with a mosaic or a map of thresholds.
    excluded : ndarray of bool, shape (H, W), optional
        The jots that are not counted.

    Raises
    ------
    ValueError
        When the image is smaller than a square.
    """
    frames, height, width = jot_shape(data)
    trials = trials_of_frame(data)
    squares = JotSquares(sensor, (height, width), excluded, trials)
    dtype = np.dtype(np.min_scalar_type(squares.side**2 * trials))
    shape = frames, *squares.size
    images: UnsignedCounts | Frames = Frames(shape, partial(squares.count, data), dtype)
    if math.prod(shape) * dtype.itemsize <= _MAX_BYTES:
        images = squares.count(data)
    return squares.stack(images), squares.sensor(frames)


def _sensor_of_squares(sensor: Sensor, good: Pattern, frames: int, side: int) -> Sensor:
    """Return the gray sensor whose jots are squares of jots."""
    light = mean_squares(good * _shares(sensor, good.shape) * np.asarray(sensor.efficiency), side)
    dark_counts = mean_squares(good * np.asarray(sensor.dark_counts), side)
    dead = mean_squares(good.astype(np.float64), side) < _MIN_JOTS
    usual = float(light.max()) or 1.0
    trials = frames * side**2
    maps: dict[str, Any] = {
        "efficiency": constant_or_map(np.maximum(light / usual, 1e-6)),
        "dark_counts": constant_or_map(dark_counts),
        "mask": dead if dead.any() else None,
    }
    return Sensor(
        frames=trials,
        gain=sensor.light_per_intensity * usual * trials,
        threshold=int(np.min(sensor.threshold)),
        max_intensity=sensor.max_intensity,
        **maps,
    )


def _shares(sensor: Sensor, shape: tuple[int, ...]) -> Array:
    """Return the share of the light that each jot reports, (H, W): that its filter passes.

    Of jots with different thresholds, it is the share of the ones of jots with the lowest one, at
    the light where these report as many ones as zeros.
    """
    if sensor.mosaic is not None:
        filters = sensor.mosaic.of_jots(*shape, sensor.oversampling)
        return np.asarray(sensor.mosaic.sensitivity[filters])
    thresholds, places = np.unique(sensor.threshold, return_inverse=True)
    rate = inverse_detection_probability(int(thresholds[0]), 0.5, 0.5)
    ones = np.array([detection_probability(int(each), rate) for each in thresholds])
    return np.asarray(ones[places].reshape(shape) / 0.5)


def enlarge_motion(motion: Motion, side: int, size: tuple[int, int]) -> Motion:
    """Return the motion of squares of jots as that of the jots.

    Parameters
    ----------
    motion : Motion
        The motion, in squares.
    side : int
        The side of a square in jots.
    size : (int, int)
        H and W in jots.

    Examples
    --------
    >>> nodes = np.zeros((1, 2, 2, 1, 1), np.float32)
    >>> nodes[0, 1] = 1.5
    >>> parts = np.ones((1, 2, 3, 1, 1), np.float32)
    >>> labels = np.zeros((16, 16), np.uint8)
    >>> motion = jl.Motion(nodes, labels, np.array([0.0, 6.0]), 0.0, "affine", parts)
    >>> enlarge_motion(motion, 2, (33, 32)).at(6)[:, 5, 7].tolist()
    [3.0, 3.0]
    """
    centers = tile_centers(size)
    axes = centers[0][:, 0], centers[1][0]
    places = [((axis - (side - 1) / 2) / side - (TILE - 1) / 2) / TILE for axis in axes]
    rows, columns = (
        _linear(place, number)
        for place, number in zip(places, motion.nodes.shape[-2:], strict=True)
    )
    nodes = side * (rows @ motion.nodes.astype(np.float64) @ columns.T)
    nearest = [
        np.clip(np.rint(place), 0, number - 1).astype(int)
        for place, number in zip(places, motion.nodes.shape[-2:], strict=True)
    ]
    # A displacement in jots is larger than in squares, and so is its error.
    information = motion.information[..., nearest[0][:, None], nearest[1]] / np.float32(side**2)
    labels = repeat_squares(motion.labels, side)
    beyond = [(0, length - known) for length, known in zip(size, labels.shape, strict=True)]
    return Motion(
        nodes.astype(np.float32),
        np.pad(labels, beyond, mode="edge"),
        motion.times,
        motion.reference,
        motion.model,
        information,
    )


def _linear(places: Array, number: int) -> Array:
    """Return the matrix that interpolates values at 0, 1, ... linearly, and extrapolates them."""
    matrix = np.zeros((len(places), number))
    if number == 1:
        matrix[:] = 1
        return matrix
    first = np.clip(np.floor(places), 0, number - 2).astype(int)
    rows = np.arange(len(places))
    matrix[rows, first + 1] = places - first
    matrix[rows, first] = 1 - matrix[rows, first + 1]
    return matrix
