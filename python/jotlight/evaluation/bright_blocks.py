"""How much of a scene is brighter than the largest intensity S, as its readings show.

A single count near saturation says little: in a white scene, half of the pixels have more ones than
intensity S explains, by chance. So the readings of blocks of pixels are summed. A block is bright
if its sum is improbable at S, and more than a scene of 1.1 S is expected to have.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.evaluation.first_frames import first_frames, on_usual_grid
from jotlight.sensing.joint_likelihood import joint_likelihood
from jotlight.sensing.merged import Merged
from jotlight.sensing.mosaic import Mosaic
from jotlight.sensing.pixel_counts import GrayImages, PixelCounts
from jotlight.sensing.response import Array, detection_probability
from jotlight.sensing.sensor import Sensor

_SIDE = 8
"""Side of a block, in pixels."""

_DEVIATIONS = 4.0
"""Number of standard deviations by which a sum exceeds that of S in a bright block."""

_LEVELS = 1.0, 1.1
"""Intensities at which sums are expected, in units of S. Bright blocks exceed both."""


@dataclasses.dataclass(frozen=True)
class _Totals:
    """The sums of readings, and what is expected of them. All arrays are (H, W) or (N, H, W)."""

    total: Array
    expected: Array
    """Expected sum at S."""
    variance: Array
    """Variance of the sum at S."""
    brighter: Array
    """Expected sum at 1.1 S."""

    @classmethod
    def of_pixels(cls, pixels: PixelCounts, sensitivity: float = 1.0) -> Self:
        """Return the ones of pixels behind a filter that passes so much of white light."""
        light = pixels.sensor.light_per_intensity * pixels.sensor.max_intensity * sensitivity
        sums = []
        for factor in _LEVELS:
            rate = pixels.efficiency * np.float64(factor * light) + pixels.dark_counts
            p = detection_probability(int(pixels.sensor.threshold), rate)
            sums.append((pixels.trials * p, pixels.trials * p * (1 - p)))
        (expected, variance), (brighter, _) = sums
        shape = pixels.counts.shape
        others = (np.broadcast_to(each, shape) for each in (expected, variance, brighter))
        return cls(pixels.counts.astype(np.float64), *others)

    def count_bright(self, own: npt.NDArray[np.bool_] | None = None) -> tuple[int, int]:
        """Return the number of bright blocks of some pixels, and that of their blocks."""
        total, expected, variance, brighter = (
            _sum_blocks(each if own is None else np.where(own, each, 0.0))
            for each in (self.total, self.expected, self.variance, self.brighter)
        )
        is_bright = (total > brighter) & (total > expected + _DEVIATIONS * np.sqrt(variance))
        return int(is_bright.sum()), int((brighter > 0).sum())


def bright_fraction(images: GrayImages, sensor: Sensor, threads: int | None = None) -> float | None:
    """Return the fraction of the blocks of gray images that are brighter than S.

    It is None where it is unknown: for equivalent counts, which do not say whether their readings
    are saturated, and for thresholds above 1 if the jots of a pixel differ.

    Examples
    --------
    >>> from jotlight.sensing.pixel_counts import gray_images
    >>> counts = np.full((16, 16), 40, np.int32)
    >>> counts[:8] = 60
    >>> bright_fraction(gray_images(counts), Sensor(frames=64))  # -log(1 - 60/64) = 2.8
    0.5
    """
    if any(isinstance(one, Merged) and one.light_share != 1 for one in images.data):
        return None
    images, sensor = first_frames(on_usual_grid(images), sensor)
    numbers = []
    for totals in _all_totals(images, sensor, threads):
        if totals is None:
            return None
        numbers.append(totals.count_bright())
    return _fraction(numbers)


def bright_fraction_of_mosaic(counted: Sequence[PixelCounts], mosaic: Mosaic) -> float:
    """Return the fraction of the blocks of the filters of a mosaic that are brighter than S.

    Examples
    --------
    >>> from jotlight.sensing.pixel_counts import count_pixels
    >>> pixels = count_pixels(np.array([[60, 30], [30, 30]]), Sensor(frames=64), None)
    >>> bright_fraction_of_mosaic([pixels], Mosaic("RGGB"))
    0.3333333333333333
    """
    return _fraction(
        _Totals.of_pixels(pixels, float(mosaic.sensitivity[index])).count_bright(places == index)
        for pixels in counted
        for places in [mosaic.full(*pixels.counts.shape)]
        for index in np.unique(places)
    )


def _fraction(numbers: Iterable[tuple[int, int]]) -> float:
    bright, blocks = np.sum([(0, 0), *numbers], axis=0).tolist()
    return float(bright / max(1, blocks))


def _all_totals(
    images: GrayImages, sensor: Sensor, threads: int | None
) -> Iterator[_Totals | None]:
    for part in images.parts(sensor):
        if sensor.has_plain_bits:
            pixels = part.count(sensor, threads)
            # P(1, s) is concave, so jots with their mean rate have at least as many ones.
            is_known = sensor.threshold == 1 or not pixels.varies_within_pixels
            yield _Totals.of_pixels(pixels) if is_known else None
            continue
        for one in part.data:
            joint = joint_likelihood(one, sensor, threads)
            levels = (np.full(joint.shape, factor * sensor.max_intensity) for factor in _LEVELS)
            (expected, _, variance), (brighter, *_) = map(joint.expected_total, levels)
            yield _Totals(joint.total, expected, variance, brighter)


def _sum_blocks(values: Array) -> Array:
    """Return the sums over blocks of pixels. Those at the right and at the bottom may be smaller.

    Examples
    --------
    >>> _sum_blocks(np.ones((9, 16))).tolist()
    [[64.0, 64.0], [8.0, 8.0]]
    """
    for axis in (-2, -1):
        values = np.add.reduceat(values, np.arange(0, values.shape[axis], _SIDE), axis)
    return values
