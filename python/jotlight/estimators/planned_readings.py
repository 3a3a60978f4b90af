"""The expected quality of readings of several bits, or with read noise, before a capture."""

import functools
from collections.abc import Callable

import numpy as np

from jotlight.sensing.multibit import ReadingLikelihood
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.response import Array
from jotlight.sensing.sensor import Sensor

_MAX_TOTALS = 1 << 17
"""Maximum number of totals of the readings of a pixel whose probabilities are computed."""

_DEVIATIONS = 12
"""Number of standard deviations from the mean at which the distribution of the total ends."""

_MIN_TOTALS = 1 << 12
"""Minimum number of totals if not all are computed. Near saturation, a few readings may be low."""

_NORMAL_STEPS = 2401
"""Number of totals that stand for a normal distribution."""

_MAX_LIGHT = 1e7
"""Maximum light at which saturation is searched."""

_STEPS = 100
"""Number of bisections of a level of light."""


class PlannedReadings:
    """The distribution of the estimated light of one pixel with equal jots.

    The estimate is the light at which the mean reading is expected. Without read noise and largest
    readings, it is the maximum of the likelihood, and otherwise close to it.
    """

    def __init__(self, sensor: Sensor, max_intensity: float | None) -> None:
        self.jots = sensor.oversampling**2
        self.efficiency, self.dark_counts = reference_jot(sensor)
        self.max_light = (
            None if max_intensity is None else max_intensity * sensor.light_per_intensity
        )
        none = np.zeros((1, 0), np.int32)
        response = sensor.jot_response()
        self._jot = ReadingLikelihood(response, none, False, self.efficiency, self.dark_counts)

    def bias_and_mse(self, frames: int, levels: Array) -> tuple[Array, Array]:
        """Return the bias and the mean square error of the clipped estimate at each level.

        They are exact sums over the distribution of the total. Where the total may have very many
        values, they are sums over a normal distribution.
        """
        number, highest = frames * self.jots, self._jot.max_reading
        max_light = self.max_light
        if max_light is None:
            max_light = float(self._light(np.array([1 - 0.5 / (number * highest)]))[0])
        bias, mse = np.empty(len(levels)), np.empty(len(levels))
        for index, level in enumerate(levels):
            totals, weights = self._totals(number, float(level))
            estimates = np.minimum(self._light(totals / (number * highest)), max_light)
            bias[index] = weights @ (estimates - level)
            mse[index] = weights @ (estimates - level) ** 2
        return bias, mse

    def _totals(self, number: int, level: float) -> tuple[Array, Array]:
        """Return totals of a number of readings at a level of light, and their probabilities."""
        highest, light = self._jot.max_reading, np.array([level])
        mean, variance, _ = (float(moment[0]) for moment in self._jot.moments(light))
        center, deviation = number * mean, np.sqrt(number * max(variance, 0.0))
        length = 1 << int(np.ceil(np.log2(2 * _DEVIATIONS * deviation + _MIN_TOTALS)))
        first = round(center) - length // 2
        if length > number * highest:
            length, first = number * highest + 1, 0
        if length > _MAX_TOTALS:
            steps = np.linspace(-_DEVIATIONS, _DEVIATIONS, _NORMAL_STEPS)
            weights = np.exp(-(steps**2) / 2)
            return center + deviation * steps, weights / weights.sum()
        # A distribution that is narrower than a period is not changed by repeating it.
        one = np.bincount(np.arange(highest + 1) % length, self._jot.distribution(light)[0], length)
        weights = np.clip(np.fft.irfft(np.fft.rfft(one) ** number, length), 0, 1)
        totals = first + np.arange(length)
        return totals.astype(np.float64), weights[totals % length]

    def information(self, levels: Array) -> Array:
        """Return the Fisher information of one reading about the light, at each level."""
        return self._jot.information_per_reading(levels)

    def saturation_light(self, frames: int, fraction: float) -> float:
        """Return the light at which all readings are the largest in a fraction of the pixels."""
        low, high, number = 0.0, _MAX_LIGHT, frames * self.jots
        for _ in range(_STEPS):
            middle = np.sqrt(max(low, 1e-3 * high) * high)
            largest = self._jot.probability(self._jot.max_reading, np.array([middle]))[0]
            is_below = number * np.log(max(largest, 1e-300)) < np.log(fraction)
            low, high = (middle, high) if is_below else (low, middle)
        return high

    def _light(self, fraction: Array) -> Array:
        """Return the light, 0 or more, at which the mean is a fraction of the largest reading."""
        low, high, inverse = self._inverse_mean
        return np.asarray(inverse(np.clip(fraction, low, high)))

    @functools.cached_property
    def _inverse_mean(self) -> tuple[float, float, Callable[[Array], Array]]:
        """The range of the mean as a fraction of the largest reading, and the light at a mean."""
        from scipy.interpolate import PchipInterpolator

        highest, noise, threshold = self._jot.response
        reach = highest + threshold + 8 * (np.sqrt(highest + threshold) + noise + 2)
        rates = np.linspace(0, np.sqrt(reach), 4097) ** 2
        light = np.maximum(rates - self.dark_counts, 0) / self.efficiency
        means = np.maximum.accumulate(self._jot.moments(light)[0]) / highest
        means, first = np.unique(means, return_index=True)
        return means[0], means[-1], PchipInterpolator(means, light[first])
