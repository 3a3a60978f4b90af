"""From how often a pixel's bits are 1 to the light on it, for many pixels at once."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.sensing.pixel_counts import PixelCounts
from jotlight.sensing.response import (
    Array,
    detection_density,
    detection_probability,
    inverse_detection_probability,
)
from jotlight.sensing.sensor import Sensor

_STEPS = 60
"""Of Newton's method between bounds at most."""

_ROWS = 1 << 14
"""Pixels at once whose jots differ, so that memory stays small."""


class UniqueCounts:
    """The distinct pairs of ones and bits among a picture's pixels, of which there are few."""

    def __init__(self, seen: PixelCounts) -> None:
        counts = seen.counts
        if isinstance(seen.trials, int) and seen.trials < counts.size:
            self.ones = np.arange(seen.trials + 1)
            self.bits = np.full(seen.trials + 1, seen.trials)
            self._places = counts
            return
        bits = np.broadcast_to(np.asarray(seen.trials, np.int64), counts.shape)
        # Both are below 2**31.
        keys, places = np.unique((bits << 31) | counts, return_inverse=True)
        self.ones, self.bits = keys & (2**31 - 1), keys >> 31
        self._places = places.reshape(counts.shape)

    def spread(self, table: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Give each pixel the value of its pair."""
        return table[self._places]


Inverse = Callable[[Array, Array], Array]
"""The light on each pixel, from tables of p and 1 - p for the distinct pairs; may be below 0."""


def light_of(seen: PixelCounts, distinct: UniqueCounts) -> Inverse:
    """How the light follows from the probability p that a bit of a pixel is 1.

    Where the jots of a pixel differ, p is their mean, and the light is kept in what S casts.
    """
    return _of_differing(seen, distinct) if seen.varies_within_pixels else _of_alike(seen, distinct)


def _of_alike(seen: PixelCounts, distinct: UniqueCounts) -> Inverse:
    def light(p: Array, rest: Array) -> Array:
        rate = distinct.spread(inverse_detection_probability(seen.sensor.threshold, p, rest))
        return np.asarray((rate - seen.dark_counts) / seen.efficiency)

    return light


def _of_differing(seen: PixelCounts, distinct: UniqueCounts) -> Inverse:
    sensor = seen.sensor
    most = sensor.max_intensity * sensor.light_per_intensity
    maps = [jots_of(seen, value).reshape(seen.counts.size, -1) for value in maps_of(sensor)]

    def light(p: Array, rest: Array) -> Array:
        guess = distinct.spread(inverse_detection_probability(sensor.threshold, p, rest))
        guess = ((guess - seen.dark_counts) / seen.efficiency).ravel()
        chance, out = distinct.spread(p).ravel(), np.empty(seen.counts.size)
        for start in range(0, out.size, _ROWS):
            part = slice(start, start + _ROWS)
            pixels = _Differing(sensor.threshold, *(map_[part] for map_ in maps))
            out[part] = pixels.light(chance[part], guess[part], most)
        return out.reshape(seen.counts.shape)

    return light


class _Differing:
    """Pixels with η, d and living of their jots, each (N, K̂²)."""

    def __init__(self, threshold: int, efficiency: Array, dark: Array, living: Array) -> None:
        self._threshold = threshold
        self._efficiency, self._dark, self._living = efficiency, dark, living
        self._number = np.maximum(living.sum(-1), 1)

    def light(self, chance: Array, guess: Array, most: float) -> Array:
        """The light in [0, most] at which the jots fire so often in the mean."""
        out = np.where(self._mean(np.zeros(chance.shape))[0] >= chance, 0.0, most)
        inside = (out > 0) & (self._mean(out)[0] > chance)
        pixels = _Differing(
            self._threshold, self._efficiency[inside], self._dark[inside], self._living[inside]
        )
        out[inside] = pixels._newton(chance[inside], guess[inside], most)
        return out

    def _newton(self, chance: Array, guess: Array, most: float) -> Array:
        low, high = np.zeros(chance.shape), np.full(chance.shape, most)
        here = np.where((guess > 0) & (guess < most), guess, most / 2)
        for _ in range(_STEPS):
            value, slope = self._mean(here)
            low, high = np.where(value < chance, here, low), np.where(value < chance, high, here)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = here + (chance - value) / slope
            near = np.abs(step - here) <= 1e-8 * here + 1e-12 * most
            if near.all():
                break
            # Rounding may take a last tiny step across a bound, which must not halve.
            there = np.where((low < step) & (step < high), step, (low + high) / 2)
            here = np.where(near, here, there)
        return here

    def _mean(self, light: Array) -> tuple[Array, Array]:
        """The jots' mean probability, and its slope."""
        rates = self._efficiency * light[:, None] + self._dark
        slope = self._living * self._efficiency * detection_density(self._threshold, rates)
        value = (self._living * detection_probability(self._threshold, rates)).sum(-1)
        return value / self._number, slope.sum(-1) / self._number


def maps_of(sensor: Sensor) -> tuple[Any, Any, Any]:
    """η, d, and which jots live: maps, or numbers for all."""
    return sensor.efficiency, sensor.dark_counts, True if sensor.mask is None else ~sensor.mask


def jots_of(seen: PixelCounts, value: Any) -> Array:
    """A map of the jots as (H, W, K̂²), or the same number for all."""
    side = seen.sensor.oversampling
    height, width = seen.counts.shape
    whole = np.broadcast_to(np.asarray(value, np.float64), (height * side, width * side))
    blocks = whole.reshape(height, side, width, side).swapaxes(1, 2)
    return blocks.reshape(height, width, side * side)
