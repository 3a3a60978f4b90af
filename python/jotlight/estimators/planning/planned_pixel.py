"""One pixel of a planned capture."""

import abc

from jotlight.array_types import Array
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.sensor import Sensor


class PlannedPixel(abc.ABC):
    """The distribution of the estimated light of one pixel with equal jots.

    Light is in photons per jot and frame, before the efficiency.

    Parameters
    ----------
    sensor : Sensor
        The sensor. Its number of frames has no effect.
    max_intensity : float or None
        S of the estimates, or None for the intensity half a reading below saturation.
    """

    def __init__(self, sensor: Sensor, max_intensity: float | None) -> None:
        self.jots = sensor.oversampling**2
        self.efficiency, self.dark_counts = reference_jot(sensor)
        self.max_light = (
            None if max_intensity is None else max_intensity * sensor.light_per_intensity
        )

    @abc.abstractmethod
    def bias_and_mse(self, frames: int, levels: Array) -> tuple[Array, Array]:
        """Return the bias and the mean square error of the clipped estimate at each level."""

    @abc.abstractmethod
    def information(self, levels: Array) -> Array:
        """Return the Fisher information of one reading about the light, at each level."""

    @abc.abstractmethod
    def saturation_light(self, frames: int, fraction: float) -> float:
        """Return the light at which all readings are the largest in a fraction of the pixels."""
