"""The number of ones and the number of valid bits of each pixel, from bits or counts."""

import dataclasses
import os
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_counts
from jotlight.errors import warn
from jotlight.sensing.bits import Bits, check_fits
from jotlight.sensing.channels import channel_views, stack_channels
from jotlight.sensing.maps import pixel_means
from jotlight.sensing.merged import Merged
from jotlight.sensing.scaled_counts import scaled_counts_hint
from jotlight.sensing.sensor import Sensor
from jotlight.sensing.values import checked_trials

Estimate = npt.NDArray[np.float32]
"""Intensities of an image, (H, W) or (H, W, C)."""

Data = Bits | Merged | npt.ArrayLike
"""Bits, merged counts, or an image of counts, (H, W) or (H, W, C)."""

Channel = Bits | Merged | npt.NDArray[np.int32]
"""The data of one channel: bits (T, H·K̂, W·K̂), or counts (H, W)."""


@dataclasses.dataclass(frozen=True)
class PixelCounts:
    """The counts of the pixels of one channel, and the sensor parameters of each pixel.

    The counts are a sufficient statistic if the bits of each pixel are exchangeable, which requires
    the box kernel and equal jots in each pixel.
    """

    sensor: Sensor
    counts: npt.NDArray[np.int32]
    """L: the number of ones of each pixel, (H, W)."""
    trials: float | npt.NDArray[np.float64]
    """The number of valid bits of each pixel: K, or a map where the pixels differ."""
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
        if np.all(self.trials):
            return None
        return np.broadcast_to(np.asarray(self.trials == 0), self.counts.shape)


def carried_sensor(data: Data) -> Sensor | None:
    """Return the sensor of bits or of merged counts. Return None for counts and bits without one.

    Raises
    ------
    TypeError
        When the sensor of the bits is not a :class:`jotlight.Sensor`.
    """
    sensor = data.sensor if isinstance(data, Bits | Merged) else None
    if not isinstance(sensor, Sensor | None):
        raise TypeError(f"sensor: expected jotlight.Sensor, got {type(sensor).__name__}")
    return sensor


def prepare_data(
    data: Data, sensor: Sensor | None, trials: npt.ArrayLike | None = None
) -> tuple[Data, Sensor]:
    """Return the data of a method with their sensor: the given one, or the one that they carry.

    Counts with `trials` become merged counts. Pixels that the sensor's mask marks have no trials.

    Raises
    ------
    TypeError
        When there is no sensor, or bits or merged counts come with `trials`.
    ValueError
        When the trials do not fit the counts.

    Examples
    --------
    >>> data, _ = prepare_data(np.array([[3, 1]]), Sensor(frames=4), trials=[[4, 2.5]])
    >>> data.trials.tolist()
    [[4.0, 2.5]]
    """
    if isinstance(data, str | os.PathLike):
        raise TypeError(
            f"data: expected bits or counts, got the path {os.fspath(data)!r}; pass "
            "jotlight.open(path) for a capture, and sensor.expose(jotlight.read_image(path)) for a "
            "photograph"
        )
    if sensor is None:
        sensor = carried_sensor(data)
    if sensor is None:
        name = "these bits" if isinstance(data, Bits) else "counts"
        raise TypeError(
            f"sensor: expected a jotlight.Sensor, because {name} carry none; pass the sensor that "
            "recorded them, such as Sensor(frames=16) for 16 trials per pixel"
        )
    if not isinstance(sensor, Sensor):
        raise TypeError(
            "sensor: expected a jotlight.Sensor, such as Sensor(frames=16) for 16 trials per "
            f"pixel, got {sensor!r}"
        )
    if trials is None:
        return data, sensor
    if isinstance(data, Bits | Merged):
        raise TypeError(
            f"trials: expected none, because {type(data).__name__} state their own number of "
            "trials; omit trials, or pass counts"
        )
    return _merge_counts(as_counts(data), sensor, trials), sensor


def _merge_counts(counts: npt.NDArray[np.int32], sensor: Sensor, trials: npt.ArrayLike) -> Merged:
    _check_jots(counts, sensor)
    checked = checked_trials(trials, counts)
    if sensor.mask is None:
        return Merged(counts, checked, sensor)
    mask = sensor.mask if counts.ndim == 2 else sensor.mask[..., None]
    mask = np.broadcast_to(mask, counts.shape)
    return Merged(np.where(mask, np.int32(0), counts), np.where(mask, 0.0, checked), sensor)


def color_channels(data: Data) -> tuple[int, ...]:
    """Return (C,) for color data, and () for gray data."""
    if isinstance(data, Bits):
        return tuple(data.shape[3:])
    return tuple(data.shape[2:] if isinstance(data, Merged) else np.shape(data)[2:])


def split_channels(data: Data) -> Iterator[Channel]:
    """Yield the bits (T, H, W) or the counts (H, W) of each channel. Gray data have one channel."""
    if isinstance(data, Bits | Merged):
        yield from data.channels()
        return
    for channel in channel_views(as_counts(data)):
        yield np.ascontiguousarray(channel)


def map_channels(method: Callable[[Channel], Estimate], data: Data) -> Estimate:
    """Return the estimate (H, W) or (H, W, C) of a method that is called for each channel."""
    estimates = [method(channel) for channel in split_channels(data)]
    return stack_channels(estimates, color=bool(color_channels(data)))


def count_pixels(data: Data, sensor: Sensor, threads: int | None) -> PixelCounts:
    """Return the pixel counts of one channel of bits or of counts. Dead jots do not count.

    Merged counts state the trials, the efficiency, and the dark counts of their pixels.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together, or a count is above K.
    """
    if isinstance(data, Merged):
        return PixelCounts(
            sensor,
            data.ones,
            _constant_or_map(data.trials),
            _constant_or_map(data.efficiency),
            _constant_or_map(data.dark_counts),
            varies_within_pixels=False,
        )
    if isinstance(data, Bits):
        check_fits(data, sensor)
        counts = data.counts(sensor.oversampling, mask=sensor.mask, threads=threads)
    else:
        counts = as_counts(data)
        _check_jots(counts, sensor)
    trials: float | npt.NDArray[np.float64] = sensor.trials
    if sensor.mask is not None:
        valid = Bits.from_array(~sensor.mask).counts(sensor.oversampling)
        trials = valid.astype(np.float64) * sensor.frames
        if not isinstance(data, Bits):
            counts = np.where(sensor.mask, np.int32(0), counts)
    if not isinstance(data, Bits):
        _check_counts(counts, sensor)
    mask, side = sensor.mask, sensor.oversampling
    efficiency, efficiency_varies = pixel_means(sensor.efficiency, mask, side)
    dark, dark_varies = pixel_means(sensor.dark_counts, mask, side)
    return PixelCounts(sensor, counts, trials, efficiency, dark, efficiency_varies or dark_varies)


def warn_about_smooth_kernel(sensor: Sensor) -> None:
    """Issue a warning if the kernel is smooth, for methods that assume the box kernel."""
    if sensor.kernel != "box":
        warn(
            f"the light of a {sensor.kernel} kernel reaches neighboring pixels, which this method "
            "does not model: it assumes the box kernel"
        )


def _constant_or_map(
    value: float | npt.NDArray[np.float64],
) -> float | npt.NDArray[np.float64]:
    """Return a map, or its number if all pixels have the same, because methods are then faster."""
    low = float(np.min(value))
    return low if low == np.max(value) else value


def _check_jots(counts: npt.NDArray[np.int32], sensor: Sensor) -> None:
    """Check that the maps of a sensor fit the counts, which do not distinguish jots."""
    sensor.check_map_shapes(*(size * sensor.oversampling for size in counts.shape[:2]))
    if sensor.oversampling > 1 and sensor.mask is not None:
        raise ValueError(
            "counts: with a mask of single jots the bits are needed, because a count does not "
            "say which jots reported 1; pass the bits, or a sensor without a mask"
        )


def _check_counts(counts: npt.NDArray[np.int32], sensor: Sensor) -> None:
    maximum = counts.max()
    if maximum > sensor.trials or counts.min() < 0:
        hint = scaled_counts_hint(counts)
        raise ValueError(
            f"counts: expected 0 to K = {sensor.trials} ones per pixel "
            f"({sensor.frames} frames of {sensor.oversampling} x {sensor.oversampling} jots), "
            f"got {counts.min()} to {maximum}" + (f"; {hint}" if hint else "")
        )
