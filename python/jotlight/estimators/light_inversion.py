"""Computation of the light on many pixels at once, from the probabilities of their bits."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.interrupts import interruptible
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.parameters.response import (
    detection_density,
    detection_probability,
    inverse_detection_probability,
)
from jotlight.sensing.sensor import Sensor

_MAX_NEWTON_STEPS = 60
"""The maximum number of steps of Newton's method with bisection."""

_MIN_RATIO = 1e-6
"""Smallest ratio of the bounds between which a bisection takes place."""

_CHUNK = 1 << 14
"""The number of pixels with unequal jots that are solved at once. It limits the memory."""


class UniqueCounts:
    """The distinct pairs of a number of ones and a number of valid bits, which are few.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import count_pixels
    >>> unique = UniqueCounts(count_pixels(np.array([[2, 0, 2]]), jl.Sensor(frames=2), None))
    >>> unique.ones.tolist(), unique.bits.tolist(), unique.expand(10 * unique.ones).tolist()
    ([0, 1, 2], [2, 2, 2], [[20, 0, 20]])
    """

    def __init__(self, pixels: PixelCounts) -> None:
        counts = pixels.counts
        if not isinstance(pixels.trials, np.ndarray) and pixels.trials < counts.size:
            self.ones = np.arange(int(pixels.trials) + 1)
            self.bits = np.full(self.ones.shape, pixels.trials)
            self._indices = counts
            return
        unique = interruptible(np.unique)
        bits, places = unique(np.asarray(pixels.trials, np.float64), return_inverse=True)
        # The place and the count are below 2**31, so that one integer holds the pair.
        places = np.broadcast_to(places.reshape(np.shape(pixels.trials)), counts.shape)
        keys, indices = unique((places << 31) | counts, return_inverse=True)
        self.ones, self.bits = keys & (2**31 - 1), bits[keys >> 31]
        self._indices = indices.reshape(counts.shape)

    def expand(self, table: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return images of the shape of the counts: for each pixel, its pair's entry in a table."""
        return table[self._indices]


LightInverse = Callable[[Array, Array], Array]
"""A function from p and 1 - p of the pairs to the light on each pixel, which may be negative."""


def build_light_inverse(pixels: PixelCounts, unique: UniqueCounts) -> LightInverse:
    """Return the inverse of the pixels' response: from the probability p of a 1 to the light.

    Where the jots of a pixel differ, p is the mean over them, and the light is limited to that of
    intensities in [0, S].

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import count_pixels
    >>> pixels = count_pixels(np.array([[1, 0]]), jl.Sensor(frames=2), None)
    >>> unique = UniqueCounts(pixels)
    >>> invert = build_light_inverse(pixels, unique)
    >>> invert(unique.ones / 2, 1 - unique.ones / 2).round(4).tolist()  # log 2 and 0
    [[0.6931, 0.0]]
    """
    if pixels.varies_within_pixels:
        return _build_unequal_inverse(pixels, unique)
    return _build_equal_inverse(pixels, unique)


def _build_equal_inverse(pixels: PixelCounts, unique: UniqueCounts) -> LightInverse:
    threshold = pixels.sensor.threshold

    def invert(p: Array, complement: Array) -> Array:
        rate = unique.expand(inverse_detection_probability(threshold, p, complement))
        return np.asarray((rate - pixels.dark_counts) / pixels.efficiency)

    return invert


def _build_unequal_inverse(pixels: PixelCounts, unique: UniqueCounts) -> LightInverse:
    sensor, size = pixels.sensor, pixels.counts.size
    max_light = sensor.max_intensity * sensor.light_per_intensity
    # All images have the same maps.
    maps = [_group_by_pixel(pixels, value) for value in jot_maps(sensor)]

    def invert(p: Array, complement: Array) -> Array:
        rate = unique.expand(inverse_detection_probability(sensor.threshold, p, complement))
        guess = ((rate - pixels.dark_counts) / pixels.efficiency).ravel()
        probability, out = unique.expand(p).ravel(), np.empty(size)
        for start in range(0, size, _CHUNK):
            chunk = np.arange(start, min(start + _CHUNK, size))
            part = _UnequalJots(sensor.threshold, *(map_[chunk % len(map_)] for map_ in maps))
            out[chunk] = part.light(probability[chunk], guess[chunk], max_light)
        return out.reshape(pixels.counts.shape)

    return invert


class _UnequalJots:
    """N pixels with unequal jots. η, d, and the live jots are arrays (N, K̂²)."""

    def __init__(self, threshold: int, efficiency: Array, dark_counts: Array, alive: Array) -> None:
        self._threshold = threshold
        self._efficiency, self._dark_counts, self._alive = efficiency, dark_counts, alive
        self._number = np.maximum(alive.sum(-1), 1)

    def light(self, probability: Array, guess: Array, max_light: float) -> Array:
        """Return the light in [0, max_light] at which the mean over the jots is `probability`."""
        dark = self._mean_probability(np.zeros(probability.shape))[0]
        out = np.where(dark >= probability, 0.0, max_light)
        inside = (out > 0) & (self._mean_probability(out)[0] > probability)
        part = _UnequalJots(
            self._threshold,
            self._efficiency[inside],
            self._dark_counts[inside],
            self._alive[inside],
        )
        out[inside] = part._solve(probability[inside], guess[inside], max_light)
        return out

    def _solve(self, probability: Array, guess: Array, max_light: float) -> Array:
        """Return the light by Newton's method, with bisection where a step leaves the bounds."""
        low, high = np.zeros(probability.shape), np.full(probability.shape, max_light)
        light = np.where((guess > 0) & (guess < max_light), guess, max_light / 2)
        tolerance = 1e-8 * self._dark_light()
        for _ in range(_MAX_NEWTON_STEPS):
            value, slope = self._mean_probability(light)
            below = value < probability
            low, high = np.where(below, light, low), np.where(below, high, light)
            # A slope of nearly 0 leads far outside the bounds, where bisection replaces the step.
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                newton = light + (probability - value) / slope
            converged = np.abs(newton - light) <= 1e-8 * light + tolerance
            if converged.all():
                break
            # Rounding can move a last tiny step across a bound, where bisection would undo it.
            inside = (low < newton) & (newton < high)
            middle = np.sqrt(np.maximum(low, _MIN_RATIO * high) * high)
            candidate = np.where(inside, newton, middle)
            light = np.where(converged, light, candidate)
        return light

    def _dark_light(self) -> Array:
        """Return the light that causes as many detections as the dark counts of each pixel."""
        efficiency, dark = (
            (self._alive * values).sum(-1) for values in (self._efficiency, self._dark_counts)
        )
        return np.asarray(np.divide(dark, efficiency, out=np.zeros(dark.shape), where=dark > 0))

    def _mean_probability(self, light: Array) -> tuple[Array, Array]:
        """Return the mean probability of a 1 over each pixel's live jots, and its derivative."""
        rates = self._efficiency * light[:, None] + self._dark_counts
        slope = self._alive * self._efficiency * detection_density(self._threshold, rates)
        value = (self._alive * detection_probability(self._threshold, rates)).sum(-1)
        return value / self._number, slope.sum(-1) / self._number


def jot_maps(sensor: Sensor) -> tuple[Any, Any, Any]:
    """Return η, d, and the live jots, each as a map over the jots or a number for all jots."""
    return sensor.efficiency, sensor.dark_counts, True if sensor.mask is None else ~sensor.mask


def _group_by_pixel(pixels: PixelCounts, value: Any) -> Array:
    """Return a map over the jots, or a number for all jots, as an array (H·W, K̂²)."""
    side = pixels.sensor.oversampling
    height, width = pixels.counts.shape[-2:]
    jots = np.broadcast_to(np.asarray(value, np.float64), (height * side, width * side))
    blocks = jots.reshape(height, side, width, side).swapaxes(1, 2)
    return blocks.reshape(height * width, side * side)
