"""The expected quality of readings of several bits, or with read noise, before a capture."""

import functools

import numpy as np

from jotlight.array_types import Array
from jotlight.estimators.planning.planned_estimates import PlannedEstimates, PlannedGroup
from jotlight.estimators.planning.planned_pixel import PlannedPixel
from jotlight.estimators.planning.saddle_point import SaddlePoints
from jotlight.sensing.likelihood.reference import saturation_rate
from jotlight.sensing.sensor import Sensor

_MAX_LIGHT = 1e7
"""Maximum light at which saturation is searched."""

_HIGH_RATIO = 10.0
"""Square of the ratio of light and error from which on the scores at the true light suffice."""

_CONTINUOUS = 0.3
"""Read noise from which on sums of scores are nearly continuous, as saddle points assume."""

_STEPS = 100
"""Number of bisections of a level of light."""


class PlannedReadings(PlannedPixel):
    """The distribution of the estimated light of one pixel whose jots report numbers.

    Parameters
    ----------
    sensor, max_intensity
        As for :class:`PlannedPixel`.
    max_level : float
        The largest level of light, in photons per jot and frame.
    """

    def __init__(self, sensor: Sensor, max_intensity: float | None, max_level: float) -> None:
        super().__init__(sensor, max_intensity)
        self._sensor = sensor
        group = PlannedGroup(sensor.jot_response(), self.efficiency, self.dark_counts)
        self._jot, self._estimates = group.jot, PlannedEstimates([group], max_level)
        self._group = group.limit(max_level)
        top = float(self._group.levels[-1])
        self._top = top if self.max_light is None else min(top, self.max_light)
        self._saddle_points = functools.cache(
            lambda level: SaddlePoints.of(self._group, level, self._top)
        )

    def bias_and_mse(self, frames: int, levels: Array) -> tuple[Array, Array]:
        """Return the bias and the mean square error of the clipped estimate at each level."""
        number = frames * self.jots
        rate = saturation_rate(self._sensor, number)
        certain = max(rate - self.dark_counts, 0.0) / self.efficiency
        max_light = certain if self.max_light is None else self.max_light
        # Between this light and a larger S, there are no estimates, but saddle points find some.
        is_continuous = self._sensor.read_noise >= _CONTINUOUS and max_light <= certain
        errors = []
        for level in levels.astype(float).tolist():
            bias, mse = self._estimates.bias_and_mse([number], level, max_light)
            # With little light, the error of the scores at the true light is too small. With much
            # light, saddle points at a few levels are too coarse, and their error is too small.
            if is_continuous and 0 < level**2 < _HIGH_RATIO * mse:
                others = self._saddle_points(level).bias_and_mse(number, max_light)
                bias, mse = max((bias, mse), others, key=lambda errors: errors[1])
            errors.append((bias, mse))
        bias, mse = np.transpose(errors)
        return bias, mse

    def information(self, levels: Array) -> Array:
        """Return the Fisher information of one reading about the light, at each level."""
        return self._jot.information_per_reading(levels)

    def saturation_light(self, frames: int, fraction: float) -> float:
        """Return the light at which all readings are the largest in a fraction of the pixels."""
        number = frames * self.jots

        def is_below(level: float) -> bool:
            largest = self._jot.probability(self._jot.max_reading, np.array([level]))[0]
            return bool(number * np.log(max(largest, 1e-300)) < np.log(fraction))

        if not is_below(0.0):  # dark counts alone saturate the readings
            return 0.0
        low, high = 0.0, _MAX_LIGHT
        for _ in range(_STEPS):
            middle = float(np.sqrt(max(low, 1e-3 * high) * high))
            low, high = (middle, high) if is_below(middle) else (low, middle)
        return high
