"""How bright the frames behind sums are, for jots that need several photons.

If the light flickers, the probability of a one in several frames is the mean of those of all
frames: R(s) = Σ w_k P(q, f_k s), with the factors f_k of the light and weights w_k. For q above 1,
this is far from the probability at the mean light, because dim pixels follow f^q.
"""

import dataclasses
import functools
from collections.abc import Iterable, Sequence

import numpy as np

from jotlight.array_types import Array, Image
from jotlight.kept import kept_property
from jotlight.sensing.parameters.response import detection_density, detection_probability

_MIN_RATE = 1e-4
"""Smallest rate in the table of a response."""

_TABLE_SIZE = 4096
"""Number of rates in the table."""


@dataclasses.dataclass(frozen=True)
class Lights:
    """The light in parts of the frames behind sums.

    Parameters
    ----------
    threshold : int
        q, above 1.
    factors : tuple of float
        f_k: the light in each part, in a unit that all sums share.
    weights : tuple of float
        w_k: the share of each part in the frames.

    Examples
    --------
    >>> flicker = Lights(3, (0.5, 1.5), (0.5, 0.5))
    >>> ones, slope = flicker.response(np.float32([2.0]))
    >>> ones.round(4).tolist(), Lights(3).response(np.float32([2.0]))[0].round(4).tolist()
    ([0.3285...], [0.3233...])
    >>> flicker.inverse(ones).round(3).tolist()
    [2.0]
    """

    threshold: int
    factors: tuple[float, ...] = (1.0,)
    weights: tuple[float, ...] = (1.0,)

    @kept_property
    def _table(self) -> tuple[Array, Array, Array]:
        """Rates in increasing order, their R, and its derivative."""
        rates, ones, slope = constant_light(self.threshold)
        if self.factors == (1.0,):
            return rates, ones, slope
        light = rates / min(self.factors)
        mean, mean_slope = np.zeros((2, _TABLE_SIZE))
        for factor, weight in zip(self.factors, self.weights, strict=True):
            mean += weight * np.interp(factor * light, rates, ones)
            mean_slope += weight * factor * np.interp(factor * light, rates, slope)
        return light, mean, mean_slope

    def response(self, light: Image) -> tuple[Image, Image]:
        """Return R(s) and its derivative."""
        rates, ones, slope = self._table
        return (
            np.interp(light, rates, ones).astype(np.float32),
            np.interp(light, rates, slope).astype(np.float32),
        )

    def inverse(self, probability: Image) -> Image:
        """Return the light s at which R(s) is a probability."""
        rates, ones, _ = self._table
        return np.interp(probability, ones, rates).astype(np.float32)


@functools.cache
def constant_light(threshold: int) -> tuple[Array, Array, Array]:
    """Return rates, P(q, s) at each, and its derivative."""
    largest = threshold + 10 * threshold**0.5 + 10
    rates = np.linspace(_MIN_RATE**0.5, largest**0.5, _TABLE_SIZE) ** 2
    return rates, detection_probability(threshold, rates), detection_density(threshold, rates)


class BlockLights:
    """The light of blocks of frames, which becomes known one by one.

    Parameters
    ----------
    threshold : int
        q, above 1.
    frames : sequence of int
        The number of frames of each block.
    blocks : iterable of int
        The first blocks, whose light is the unit until it is set.

    Examples
    --------
    >>> lights = BlockLights(2, [8, 8, 16], [1])
    >>> lights.factors[2] = 1.5
    >>> lights.of([1, 2])
    Lights(threshold=2, factors=(1.0, 1.5), weights=(0.333..., 0.666...))
    """

    def __init__(self, threshold: int, frames: Sequence[int], blocks: Iterable[int]) -> None:
        self._threshold, self._frames = threshold, frames
        self.factors = dict.fromkeys(blocks, 1.0)
        """The light of each block that is known."""

    def of(self, blocks: Iterable[int]) -> Lights:
        """Return the light of the sums of some blocks."""
        known = [block for block in blocks if block in self.factors]
        if not known:
            return Lights(self._threshold)
        total = sum(self._frames[block] for block in known)
        return Lights(
            self._threshold,
            tuple(self.factors[block] for block in known),
            tuple(self._frames[block] / total for block in known),
        )
