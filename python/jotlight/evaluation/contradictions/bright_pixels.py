"""Which pixels are brighter than the largest intensity S, as their readings show.

In a white scene, half of the pixels have more ones than intensity S explains, by chance. So a pixel
is bright only if its sum of readings is so large that noise alone makes a single pixel of a white
image so bright at most once in a million images. The same holds for the sum of its block: a region
of few readings per pixel is bright although none of its pixels shows it, and a star although its
block is dark.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Self

import numpy as np

from jotlight.array_types import Array, Mask
from jotlight.evaluation.contradictions.first_frames import first_frames, on_usual_grid
from jotlight.layout import join
from jotlight.sensing.data.pixel_counts import GrayImages, PixelCounts
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.response import detection_probability
from jotlight.sensing.sensor import Sensor

_SIDE = 8
"""Side of a block, in pixels."""

_MAX_FALSE = 1e-6
"""Largest probability that noise alone makes any pixel of an image of intensity S bright."""


@dataclasses.dataclass(frozen=True)
class _Sums:
    """Sums of readings, and what is expected of them. All arrays are (N, H, W)."""

    total: Array
    expected: Array
    """Expected sum at S."""
    variance: Array
    """Variance of the sum at S."""

    @classmethod
    def of_pixels(cls, pixels: PixelCounts, sensitivity: float = 1.0) -> Self:
        """Return the ones of pixels behind a filter that passes so much of white light."""
        light = pixels.sensor.light_per_intensity * pixels.sensor.max_intensity * sensitivity
        rate = pixels.efficiency * np.float64(light) + pixels.dark_counts
        p = detection_probability(int(pixels.sensor.threshold), rate)
        shape, trials = pixels.counts.shape, np.asarray(pixels.trials, np.float64)
        moments = (np.broadcast_to(each, shape) for each in (trials * p, trials * p * (1 - p)))
        return cls(pixels.counts.astype(np.float64), *moments)

    def each(self, function: Callable[[Array], Array]) -> Self:
        """Return the results of a function of each array."""
        return type(self)(*map(function, (self.total, self.expected, self.variance)))

    def are_bright(self, number: int) -> Mask:
        """Return where a sum is too large for S, if it is one of a number of sums of an image.

        By Bernstein's inequality, a sum of bits or photons exceeds its expectation by t or more
        with a probability of at most exp(-t²/(2 (variance + t/3))).
        """
        logarithm = math.log(max(number, 1) / _MAX_FALSE)
        excess = logarithm / 3 + np.sqrt(logarithm**2 / 9 + 2 * logarithm * self.variance)
        return np.asarray(self.total > self.expected + excess)

    def bright_pixels(self, own: Mask | None = None) -> Mask:
        """Return which pixels are bright, by themselves or with their block; all, or some."""
        sums = self if own is None else self.each(lambda values: own * values)
        blocks, (height, width) = sums.each(_sum_blocks), self.total.shape[-2:]
        number = height * width + math.prod(blocks.total.shape[-2:])
        spread = blocks.are_bright(number).repeat(_SIDE, -2).repeat(_SIDE, -1)
        bright = sums.are_bright(number) | spread[..., :height, :width]
        return np.asarray(bright if own is None else bright & own)


def bright_pixels(images: GrayImages, sensor: Sensor, threads: int | None = None) -> Mask | None:
    """Return which pixels of gray images are brighter than S, (N, H, W).

    It is None where it is unknown: for equivalent counts, which do not say whether their readings
    are saturated, and for thresholds above 1 if the jots of a pixel differ.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import gray_images
    >>> counts = np.full((16, 16), 400, np.int32)
    >>> counts[2, 3] = 600
    >>> sensor = jl.Sensor(frames=640)
    >>> bright = bright_pixels(gray_images(counts), sensor)  # -log(1 - 600/640) = 2.8
    >>> np.argwhere(bright).tolist()
    [[0, 2, 3]]
    """
    if any(isinstance(one, Merged) and one.light_share != 1 for one in images.data):
        return None
    found = []
    for sums in _all_sums(on_usual_grid(images), sensor, threads):
        if sums is None:
            return None
        found.append(sums.bright_pixels())
    return join(found)


def bright_in_first_frames(
    images: GrayImages, sensor: Sensor, threads: int | None = None
) -> Mask | None:
    """Return which pixels are brighter than S, as :func:`bright_pixels`, by the first frames."""
    return bright_pixels(*first_frames(images, sensor), threads)


def bright_behind_mosaic(counted: Sequence[PixelCounts], mosaic: Mosaic) -> Mask:
    """Return which pixels of the images of a mosaic are brighter than S, (N, H, W).

    Pixels are compared with those behind the same filter.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import count_pixels
    >>> pixels = count_pixels(np.array([[600, 300], [300, 300]]), jl.Sensor(frames=640), None)
    >>> bright_behind_mosaic([pixels], Mosaic("RGGB")).tolist()
    [[[True, False], [False, False]]]
    """
    found = []
    for pixels in counted:
        places = mosaic.full(*pixels.counts.shape[-2:])
        bright = np.zeros(pixels.counts.shape, np.bool_)
        for index in np.unique(places):
            sums = _Sums.of_pixels(pixels, float(mosaic.sensitivity[index]))
            bright |= sums.bright_pixels(places == index)
        found.append(bright[None])
    return join(found)


def _all_sums(images: GrayImages, sensor: Sensor, threads: int | None) -> Iterator[_Sums | None]:
    for part in images.parts(sensor):
        if sensor.has_plain_bits:
            pixels = part.count(sensor, threads)
            # P(1, s) is concave, so jots with their mean rate have at least as many ones.
            is_known = sensor.threshold == 1 or not pixels.varies_within_pixels
            yield _Sums.of_pixels(pixels) if is_known else None
            continue
        for one in part.data:
            joint = joint_likelihood(one, sensor, threads)
            white = np.full(joint.shape, sensor.max_intensity)
            expected, _, variance = joint.expected_total(white)
            yield _Sums(joint.total[None], expected[None], variance[None])


def _sum_blocks(values: Array) -> Array:
    """Return the sums over blocks of pixels. Those at the right and at the bottom may be smaller.

    Examples
    --------
    >>> _sum_blocks(np.ones((9, 16))).tolist()
    [[64.0, 64.0], [8.0, 8.0]]
    """
    if not any(values.strides):  # the same number everywhere
        sides = (np.diff([*range(0, size, _SIDE), size]) for size in values.shape[-2:])
        sums = np.multiply.outer(*sides) * values.flat[0]
        return np.broadcast_to(sums, (*values.shape[:-2], *sums.shape))
    for axis in (-2, -1):
        values = np.add.reduceat(values, np.arange(0, values.shape[axis], _SIDE), axis)
    return values
