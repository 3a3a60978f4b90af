"""What a pixel's bits amount to: ones out of so many valid bits, from bits or from counts."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.checks import refuse_masked
from jotlight.errors import warn
from jotlight.sensing.bits import Bits, check_fits
from jotlight.sensing.sensor import Sensor


@dataclasses.dataclass(frozen=True)
class PixelCounts:
    """What a sensor saw of every pixel, where the pixel's bits are exchangeable (box kernel)."""

    sensor: Sensor
    counts: npt.NDArray[np.int32]
    """L, (H, W)."""
    trials: int | npt.NDArray[np.int32]
    """Valid bits of each pixel: K, or a map where jots are dead."""
    efficiency: float | npt.NDArray[np.float64]
    """η of each pixel's jots: a number or a map (H, W), the mean where a pixel's jots differ."""
    dark_counts: float | npt.NDArray[np.float64]
    """d, likewise."""
    jots_differ: bool
    """Whether the jots inside of some pixel differ in their efficiency or dark counts."""

    @property
    def uniform(self) -> bool:
        """Whether nothing but their counts tells the pixels apart."""
        told = self.trials, self.efficiency, self.dark_counts
        return not self.jots_differ and not any(isinstance(value, np.ndarray) for value in told)

    @property
    def blind(self) -> npt.NDArray[np.bool_] | None:
        """Pixels without a valid bit, if there are any."""
        if isinstance(self.trials, int) or self.trials.all():
            return None
        return np.asarray(self.trials == 0)


def count_pixels(data: Bits | npt.ArrayLike, sensor: Sensor, threads: int | None) -> PixelCounts:
    """Count the valid ones of each pixel, from bits or from an image of counts of one channel."""
    if isinstance(data, Bits):
        check_fits(data, sensor)
        _, height, width = data.shape
        counts = data.counts(sensor.oversampling, mask=sensor.mask, threads=threads)
    else:
        counts = as_counts(data)
        height, width = (size * sensor.oversampling for size in counts.shape)
        sensor.check_jots(height, width)
        if sensor.oversampling > 1 and sensor.mask is not None:
            raise ValueError(
                "counts: with a mask of single jots the bits are needed, since a count does not "
                "tell which jots fired; give the bits, or a sensor without mask"
            )
    trials: int | npt.NDArray[np.int32] = sensor.bits_per_pixel
    if sensor.mask is not None:
        valid = Bits.from_array(~sensor.mask).counts(sensor.oversampling)
        trials = valid * np.int32(sensor.frames)
        if not isinstance(data, Bits):
            counts = np.where(sensor.mask, np.int32(0), counts)
    if not isinstance(data, Bits):
        _check_counts(counts, sensor)
    efficiency, differs = _by_pixel(sensor, sensor.efficiency)
    dark, dark_differs = _by_pixel(sensor, sensor.dark_counts)
    return PixelCounts(sensor, counts, trials, efficiency, dark, differs or dark_differs)


def _check_counts(counts: npt.NDArray[np.int32], sensor: Sensor) -> None:
    most = counts.max()
    if most > sensor.bits_per_pixel or counts.min() < 0:
        raise ValueError(
            f"counts: expected 0 to K = {sensor.bits_per_pixel} ones per pixel "
            f"({sensor.frames} frames of {sensor.oversampling} x {sensor.oversampling} jots), "
            f"got {counts.min()} to {most}"
        )


def warn_about_smooth_kernel(sensor: Sensor) -> None:
    """Say that a method takes each pixel's bits by themselves although they are not."""
    if sensor.kernel != "box":
        warn(
            f"the light of a {sensor.kernel} kernel reaches neighbouring pixels, which this method "
            "does not know: it takes the kernel for a box"
        )


def as_counts(data: npt.ArrayLike) -> npt.NDArray[np.int32]:
    """Check an image of counts, (H, W) or (H, W, C)."""
    refuse_masked("counts", data)
    counts = np.asarray(data)
    if counts.dtype.kind not in "iu":
        raise TypeError(
            f"data: expected jotlight.Bits or an image of counts in whole numbers, got "
            f"{counts.dtype}; Bits.from_array takes bool, and rounded floats can be cast by "
            "astype(int)"
        )
    if counts.ndim not in (2, 3) or counts.size == 0 or (counts.ndim == 3 and counts.shape[2] > 4):
        raise ValueError(
            f"counts: expected shape (H, W) or (H, W, C) with at most 4 channels, got "
            f"{counts.shape}; Bits.from_array takes the single frames (T, H, W) of 0 and 1"
        )
    if counts.min() < 0 or counts.max() >= 2**31:
        raise ValueError(f"counts: expected 0 to 2**31 - 1, got {counts.min()} to {counts.max()}")
    return np.require(counts, np.int32, ["C", "ALIGNED"])


def _by_pixel(
    sensor: Sensor, value: float | npt.NDArray[np.float32]
) -> tuple[float | npt.NDArray[np.float64], bool]:
    """The mean over each pixel's living jots, and whether they differ anywhere."""
    if not isinstance(value, np.ndarray):
        return value, False
    side = sensor.oversampling
    height, width = (size // side for size in value.shape)
    blocks = value.astype(np.float64).reshape(height, side, width, side)
    valid = np.ones(blocks.shape, bool)
    if sensor.mask is not None:
        valid = ~sensor.mask.reshape(blocks.shape)
    number = np.maximum(valid.sum(axis=(1, 3)), 1)
    # Of a pixel without a living jot nothing is asked but that the numbers be in range.
    mean = np.where(valid, blocks, 0).sum(axis=(1, 3)) / number
    mean = np.where(valid.any(axis=(1, 3)), mean, blocks.mean(axis=(1, 3)))
    differs = valid & (blocks != mean[:, None, :, None].astype(np.float32))
    return np.ascontiguousarray(mean), bool(differs.any())
