"""The expected quality of readings of several bits, or with read noise, before a capture."""

import numpy as np

from jotlight.sensing.multibit import ReadingLikelihood
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.response import Array
from jotlight.sensing.sensor import Sensor

_MAX_TOTAL = 1 << 17
"""Maximum total of the readings of a pixel whose distribution is computed."""

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

        They are exact sums over the distribution of the total, and for very long totals those of a
        normal one.
        """
        number, highest = frames * self.jots, self._jot.max_reading
        if number * highest > _MAX_TOTAL:
            _, variance, slope = self._jot.moments(levels)
            return np.zeros(len(levels)), variance / number / slope**2
        totals = np.arange(number * highest + 1)
        max_light = self.max_light
        if max_light is None:
            max_light = float(self._light(np.array([1 - 0.5 / totals[-1]]))[0])
        estimates = np.minimum(self._light(totals / totals[-1]), max_light)
        bias, mse = np.empty(len(levels)), np.empty(len(levels))
        for index, level in enumerate(levels):
            one = self._jot.distribution(np.array([level]))[0]
            spectrum = np.fft.rfft(one, len(totals)) ** number
            weights = np.clip(np.fft.irfft(spectrum, len(totals)), 0, 1)
            bias[index] = weights @ (estimates - level)
            mse[index] = weights @ (estimates - level) ** 2
        return bias, mse

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
        highest, noise, threshold = self._jot.response
        reach = highest + threshold + 8 * (np.sqrt(highest + threshold) + noise + 2)
        rates = np.linspace(0, np.sqrt(reach), 4097) ** 2
        light = np.maximum(rates - self.dark_counts, 0) / self.efficiency
        means = self._jot.moments(light)[0] / highest
        return np.asarray(np.interp(fraction, means, light))
