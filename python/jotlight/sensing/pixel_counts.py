"""The number of ones and the number of valid bits of each pixel, from bits or counts."""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_counts
from jotlight.errors import warn
from jotlight.sensing.bits import Bits, check_fits
from jotlight.sensing.channels import channel_views, stack_channels
from jotlight.sensing.sensor import Sensor

Estimate = npt.NDArray[np.float32]
"""Intensities of an image, (H, W) or (H, W, C)."""


@dataclasses.dataclass(frozen=True)
class PixelCounts:
    """The counts of the pixels of one channel, and the sensor parameters of each pixel.

    The counts are a sufficient statistic if the bits of each pixel are exchangeable, which requires
    the box kernel and equal jots in each pixel.
    """

    sensor: Sensor
    counts: npt.NDArray[np.int32]
    """L: the number of ones of each pixel, (H, W)."""
    trials: int | npt.NDArray[np.int32]
    """The number of valid bits of each pixel: K, or a map where jots are dead."""
    efficiency: float | npt.NDArray[np.float64]
    """η of each pixel: a number or a map (H, W), with the mean over its jots where they differ."""
    dark_counts: float | npt.NDArray[np.float64]
    """d of each pixel: a number or a map (H, W), with the mean over its jots where they differ."""
    varies_within_pixels: bool
    """Whether any pixel has jots that differ in efficiency or dark counts."""

    @property
    def uniform(self) -> bool:
        """Whether all pixels have the same trials, efficiency, and dark counts."""
        parameters = self.trials, self.efficiency, self.dark_counts
        return not self.varies_within_pixels and not any(
            isinstance(value, np.ndarray) for value in parameters
        )

    @property
    def dead_pixels(self) -> npt.NDArray[np.bool_] | None:
        """The pixels without a valid bit, if there are any."""
        if isinstance(self.trials, int) or self.trials.all():
            return None
        return np.asarray(self.trials == 0)


def carried_sensor(data: Bits | npt.ArrayLike) -> Sensor | None:
    """Return the sensor of bits. Return None for counts, and for bits without a sensor.

    Raises
    ------
    TypeError
        When the sensor of the bits is not a :class:`jotlight.Sensor`.
    """
    sensor = data.sensor if isinstance(data, Bits) else None
    if not isinstance(sensor, Sensor | None):
        raise TypeError(f"sensor: expected jotlight.Sensor, got {type(sensor).__name__}")
    return sensor


def split_channels(data: Bits | npt.ArrayLike) -> Iterator[Bits | npt.NDArray[np.int32]]:
    """Yield the bits (T, H, W) or the counts (H, W) of each channel. Gray data have one channel."""
    if isinstance(data, Bits):
        yield from data.channels()
        return
    for channel in channel_views(as_counts(data)):
        yield np.ascontiguousarray(channel)


def map_channels(
    method: Callable[[Bits | npt.NDArray[np.int32]], Estimate], data: Bits | npt.ArrayLike
) -> Estimate:
    """Return the estimate (H, W) or (H, W, C) of a method that is called for each channel."""
    estimates = [method(channel) for channel in split_channels(data)]
    dimensions = len(data.shape) - 1 if isinstance(data, Bits) else np.ndim(data)
    return stack_channels(estimates, color=dimensions == 3)


def count_pixels(data: Bits | npt.ArrayLike, sensor: Sensor, threads: int | None) -> PixelCounts:
    """Return the pixel counts of one channel of bits or of counts. Dead jots do not count.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together, or a count is above K.
    """
    if isinstance(data, Bits):
        check_fits(data, sensor)
        _, height, width = data.shape
        counts = data.counts(sensor.oversampling, mask=sensor.mask, threads=threads)
    else:
        counts = as_counts(data)
        height, width = (size * sensor.oversampling for size in counts.shape)
        sensor.check_map_shapes(height, width)
        if sensor.oversampling > 1 and sensor.mask is not None:
            raise ValueError(
                "counts: with a mask of single jots the bits are needed, because a count does not "
                "say which jots reported 1; pass the bits, or a sensor without a mask"
            )
    trials: int | npt.NDArray[np.int32] = sensor.trials
    if sensor.mask is not None:
        valid = Bits.from_array(~sensor.mask).counts(sensor.oversampling)
        trials = valid * np.int32(sensor.frames)
        if not isinstance(data, Bits):
            counts = np.where(sensor.mask, np.int32(0), counts)
    if not isinstance(data, Bits):
        _check_counts(counts, sensor)
    efficiency, efficiency_varies = _pixel_means(sensor, sensor.efficiency)
    dark, dark_varies = _pixel_means(sensor, sensor.dark_counts)
    return PixelCounts(sensor, counts, trials, efficiency, dark, efficiency_varies or dark_varies)


def warn_about_smooth_kernel(sensor: Sensor) -> None:
    """Issue a warning if the kernel is smooth, for methods that assume the box kernel."""
    if sensor.kernel != "box":
        warn(
            f"the light of a {sensor.kernel} kernel reaches neighboring pixels, which this method "
            "does not model: it assumes the box kernel"
        )


def _check_counts(counts: npt.NDArray[np.int32], sensor: Sensor) -> None:
    maximum = counts.max()
    if maximum > sensor.trials or counts.min() < 0:
        raise ValueError(
            f"counts: expected 0 to K = {sensor.trials} ones per pixel "
            f"({sensor.frames} frames of {sensor.oversampling} x {sensor.oversampling} jots), "
            f"got {counts.min()} to {maximum}"
        )


def _pixel_means(
    sensor: Sensor, value: float | npt.NDArray[np.float32]
) -> tuple[float | npt.NDArray[np.float64], bool]:
    """Return the mean over the live jots of each pixel, and whether those of any pixel differ."""
    if not isinstance(value, np.ndarray):
        return value, False
    side = sensor.oversampling
    height, width = (size // side for size in value.shape)
    blocks = value.astype(np.float64).reshape(height, side, width, side)
    valid = np.ones(blocks.shape, bool)
    if sensor.mask is not None:
        valid = ~sensor.mask.reshape(blocks.shape)
    live_jots = np.maximum(valid.sum(axis=(1, 3)), 1)
    mean = np.where(valid, blocks, 0).sum(axis=(1, 3)) / live_jots
    # The value of a dead pixel is never used, but it must pass the checks of the range.
    mean = np.where(valid.any(axis=(1, 3)), mean, blocks.mean(axis=(1, 3)))
    differs = valid & (blocks != mean[:, None, :, None].astype(np.float32))
    return np.ascontiguousarray(mean), bool(differs.any())
