"""How the ones of a frame depend on its light, for readings that become counts of single bits."""

from typing import NamedTuple

import numpy as np

from jotlight.array_types import Array
from jotlight.sensing.likelihood.multibit import reading_probability
from jotlight.sensing.sensor import Sensor

_RATES = 1025
"""Number of rates in the table of the response."""


class Response(NamedTuple):
    """The ones of one frame at some rates, in photons per frame."""

    rates: Array
    mean: Array
    """Mean fraction of ones, which increases."""
    variance: Array
    """Variance of the fraction of ones."""
    slope: Array
    """Derivative of the mean."""

    def at(self, rates: Array) -> list[Array]:
        """Return the mean, the variance, and the slope at some rates."""
        return [np.interp(rates, self.rates, part) for part in self[1:]]

    @classmethod
    def of(
        cls, sensor: Sensor, threshold: int, trials: int, ones: Array, bright: int | None
    ) -> "Response":
        """Return the response up to rates at which nearly all readings are bright ones.

        Parameters
        ----------
        sensor : Sensor
            The sensor of the readings. Its gain does not matter.
        threshold : int
            q, for readings of one bit.
        trials : int
            The number of trials of a frame.
        ones : ndarray of float
            The mean number of ones of each reading.
        bright : int, optional
            A reading that few others exceed, for readings of several bits.
        """
        highest = threshold if bright is None else min(sensor.max_reading, 2 * bright + 16)
        reach = highest + 8 * (np.sqrt(highest) + sensor.read_noise + 2)
        rates = np.linspace(0, np.sqrt(reach), _RATES) ** 2
        readings = np.arange(min(sensor.max_reading, int(2 * reach)) + 1)
        probability = reading_probability(
            readings,
            rates[:, None],
            bit_depth=sensor.bit_depth,
            read_noise=sensor.read_noise,
            threshold=threshold,
        )
        ones = ones[: len(readings)]
        part = ones % 1
        mean = probability @ ones
        variance = probability @ (ones**2 + part * (1 - part)) - mean**2
        mean = np.maximum.accumulate(mean / trials)
        return cls(rates, mean, variance / trials**2, np.gradient(mean, rates))
