"""The likelihood of one group of readings, whose sum is the joint likelihood of all."""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.likelihood.multibit import ReadingLikelihood
from jotlight.sensing.parameters.response import detection_density, detection_probability
from jotlight.squares import repeat_squares


@dataclasses.dataclass(frozen=True)
class Term:
    """The likelihood of one group. Its cells are the pixels, or the jots where these differ."""

    cells: Likelihood | ReadingLikelihood
    """The likelihood of the cells, (H·side, W·side), or of the live ones among them, (n,)."""
    light: float
    """The light of a jot per frame at intensity 1."""
    side: int
    """The number of cells per pixel and dimension."""
    live: npt.NDArray[np.bool_] | None
    """The cells with readings of this group, (H·side, W·side), or None for all."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(H·side, W·side)."""
        return self.cells.shape if self.live is None else self.live.shape

    @property
    def uniform(self) -> bool:
        """Whether all cells have the same trials, efficiency, and dark counts."""
        cells, trials = self.cells, self.cells.trials
        if isinstance(cells, ReadingLikelihood) and (cells.trials == cells.trials.flat[0]).all():
            trials = 1.0
        parameters = trials, cells.efficiency, cells.dark_counts, self.live
        return not any(isinstance(value, np.ndarray) for value in parameters)

    @property
    def max_reading(self) -> int:
        """The largest reading, 2^b - 1."""
        return self.cells.max_reading if isinstance(self.cells, ReadingLikelihood) else 1

    @property
    def trials(self) -> Array:
        """The number of readings of each cell."""
        return np.broadcast_to(np.asarray(self.cells.trials, np.float64), self.cells.shape)

    @property
    def total(self) -> Array:
        """The sum of the readings of each cell."""
        cells = self.cells
        if isinstance(cells, ReadingLikelihood):
            return cells.total
        return np.asarray(cells.ones.astype(np.float64))

    def engine_argument(self) -> tuple[Any, float, int, npt.NDArray[np.int32] | None]:
        """Return the term as the engine's functions of joint likelihoods expect it."""
        places = None
        if self.live is not None:
            places = np.where(self.live, self.live.cumsum().reshape(self.live.shape) - 1, -1)
            places = places.reshape(-1).astype(np.int32)
        return self.cells.engine_argument(), self.light, self.side, places

    def spread(self, intensity: Array) -> Array:
        """Return the light of each cell of the likelihood."""
        light = self.light * intensity
        if self.side > 1:
            light = repeat_squares(light, self.side)
        return light if self.live is None else light[self.live]

    def sum_pixels(self, values: Array) -> Array:
        """Return the sums over the cells of each pixel."""
        if self.live is not None:
            everywhere = np.zeros(self.live.shape)
            everywhere[self.live] = values
            values = everywhere
        if self.side == 1:
            return values
        height, width = (size // self.side for size in values.shape)
        blocks = values.reshape(height, self.side, width, self.side)
        return np.asarray(blocks.sum(axis=(1, 3)))

    def expected_total(self, intensity: Array) -> tuple[Array, Array, Array]:
        """Return the expected sum of the readings of each pixel, its derivative, and its variance.

        For bits, it is n P(q, η s + d). The derivative is that about the intensity. Where cells
        are uniform, any shape is allowed.
        """
        cells = self.cells
        if isinstance(cells, ReadingLikelihood):
            trials: float | Array = float(cells.trials.flat[0]) if self.uniform else cells.trials
            mean, variance, slope = cells.moments(self.spread(intensity))
        else:
            trials = cells.trials
            rate = cells.efficiency * self.spread(intensity) + cells.dark_counts
            slope = cells.efficiency * detection_density(cells.threshold, rate)
            mean = detection_probability(cells.threshold, rate)
            variance = mean * (1 - mean)
        return (
            self.sum_pixels(trials * mean),
            self.light * self.sum_pixels(trials * slope),
            self.sum_pixels(trials * variance),
        )
