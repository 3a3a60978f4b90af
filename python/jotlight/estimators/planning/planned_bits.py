"""The expected quality of plain bits of one gain and threshold, before a capture."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.planning.planned_pixel import PlannedPixel
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.parameters.response import (
    detection_probability,
    inverse_detection_probability,
)
from jotlight.sensing.sensor import Sensor

_MAX_SIGMAS = 12
"""The number of standard deviations from the mean at which the sums over counts end."""

COUNTS_PER_SIGMA = 100
"""The maximum number of counts per standard deviation in the sums."""


class PlannedBits(PlannedPixel):
    """The distribution of the estimated light of one pixel whose jots report bits."""

    def __init__(self, sensor: Sensor, max_intensity: float | None) -> None:
        super().__init__(sensor, max_intensity)
        self.threshold = sensor.threshold

    def bias_and_mse(self, frames: int, levels: Array) -> tuple[Array, Array]:
        """Return the bias and the mean square error of the clipped estimate at each level."""
        bits = frames * self.jots
        rates = self.efficiency * levels + self.dark_counts
        probabilities = detection_probability(self.threshold, rates)
        max_light = self.max_light
        if max_light is None:
            # Dark counts alone may saturate the bits.
            max_light = max(float(self._light(1 - 0.5 / bits, 0.5 / bits)), 0.0)
        bias, mse = np.empty(len(levels)), np.empty(len(levels))
        for index, (level, probability) in enumerate(zip(levels, probabilities, strict=True)):
            counts, weights = _binomial_weights(bits, float(probability))
            estimates = np.clip(self._light(counts / bits, (bits - counts) / bits), 0, max_light)
            bias[index] = weights @ (estimates - level)
            mse[index] = weights @ (estimates - level) ** 2
        return bias, mse

    def information(self, levels: Array) -> Array:
        """Return the Fisher information of one bit about the light, at each level."""
        return Likelihood(
            np.zeros(levels.shape, np.int32),
            threshold=self.threshold,
            efficiency=self.efficiency,
            dark_counts=self.dark_counts,
        ).information(levels)

    def saturation_light(self, frames: int, fraction: float) -> float:
        """Return the light at which all bits are 1 in a fraction of the pixels."""
        # The probability of a 1 is so close to 1 that its complement needs its own formula.
        logarithm = np.log(fraction) / (frames * self.jots)
        return float(np.maximum(self._light(np.exp(logarithm), -np.expm1(logarithm)), 0))

    def _light(self, probability: npt.ArrayLike, complement: npt.ArrayLike) -> Array:
        rate = inverse_detection_probability(self.threshold, probability, complement)
        return np.asarray((rate - self.dark_counts) / self.efficiency)


def _binomial_weights(bits: int, probability: float) -> tuple[Array, Array]:
    """Return the counts with noticeable probability, and their normalized probabilities."""
    from scipy.special import gammaln, xlog1py, xlogy

    mean, sigma = bits * probability, np.sqrt(bits * probability * (1 - probability))
    reach = _MAX_SIGMAS * sigma + 2 * _MAX_SIGMAS
    # For a wide distribution, a grid of every `step`-th count suffices: with bell-shaped weights,
    # the sums of smooth functions agree to far more than ten digits.
    step = max(1, int(sigma / COUNTS_PER_SIGMA))
    counts = np.arange(max(0, int(mean - reach)), min(bits, int(mean + reach) + 1) + 1.0, step)
    logarithms = xlogy(counts, probability) + xlog1py(bits - counts, -probability)
    logarithms -= gammaln(counts + 1) + gammaln(bits - counts + 1)
    weights = np.exp(logarithms - logarithms.max())
    return counts, weights / weights.sum()
