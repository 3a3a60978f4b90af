"""The counts of jots, and their detections per frame, for any threshold."""

import dataclasses

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import Array, Counts
from jotlight.interrupts import interruptible
from jotlight.sensing.parameters.response import detection_density, detection_probability


@dataclasses.dataclass(frozen=True, eq=False)
class JotCounts:
    """The counts of the jots in a capture."""

    ones: Counts
    """L: the number of ones of each jot."""
    frames: int
    """T: the number of frames."""
    threshold: int
    """q: the number of photons that make a jot report 1."""

    @property
    def fractions(self) -> Array:
        """L/T of each jot."""
        return np.asarray(self.ones / self.frames)

    def detections(self) -> Array:
        """Return the most likely detections per frame of each jot: P⁻¹(q, L/T).

        For L = T, they would be infinite, so T - 1/2 replaces L.

        Examples
        --------
        >>> JotCounts(np.array([[0, 5, 10]], np.int32), 10, 1).detections().round(3).tolist()
        [[0.0, 0.693, 2.996]]
        """
        unique, index = interruptible(np.unique)(self.ones, return_inverse=True)
        fractions = np.minimum(unique, self.frames - 0.5) / self.frames
        rates = [
            engine.inverse_detection_probability(self.threshold, float(fraction))
            for fraction in fractions
        ]
        return np.asarray(rates, np.float64)[index].reshape(self.ones.shape)

    def variance(self, rates: Array) -> Array:
        """Return the variance of :meth:`detections` of jots with these rates, to first order.

        It is p(1 - p)/T divided by the square of ∂P/∂s. Rates are clipped to those of 1/2 and
        T - 1/2 counts.
        """
        low, high = (
            engine.inverse_detection_probability(self.threshold, fraction)
            for fraction in (0.5 / self.frames, 1 - 0.5 / self.frames)
        )
        s = np.clip(rates, low, high)
        p = detection_probability(self.threshold, s)
        return np.asarray(p * (1 - p) / self.frames / detection_density(self.threshold, s) ** 2)
