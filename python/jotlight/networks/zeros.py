"""K-conditioned networks in terms of zeros, for bright sensors.

Near saturation, the probability P(b = 1) is close to 1, and float32 holds only a few digits of
1 - P(b = 1), on which the intensity depends. So for bright sensors, a network estimates P(b = 0)
from the zeros. Its last spline, which maps to P(b = 1), is replaced by its complement.
"""

import dataclasses
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from jotlight.networks.conditioning import conditioning_weights, count_sets
from jotlight.networks.inference import Inference
from jotlight.networks.layer import Layer
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor

Image = npt.NDArray[np.float32]

_BRIGHT = 4.0
"""Rate at the largest intensity, in detections per jot and frame, above which a sensor is bright.

Below, 1 - P(b = 1) exceeds 0.018 and has five digits. Above, the rounding error of P(b = 0) near 1
changes no intensity by more than 1.5e-8 of the largest one.
"""


class ConditionalNetwork(Protocol):
    """A K-conditioned network, whose layers depend on K."""

    @property
    def layers(self) -> Sequence[Layer]:
        """Layers with sets of parameters."""

    @property
    def trials_range(self) -> tuple[int, int] | None:
        """Smallest and largest K."""

    @property
    def rotations(self) -> int:
        """Number of rotations over which the output is averaged."""

    def conditioned_layers(self, trials: int) -> Sequence[Layer]:
        """Return the layers for K = `trials`."""


def is_bright(sensor: Sensor) -> bool:
    """Return whether networks estimate P(b = 0) for a sensor.

    For q > 1, rounding errors of P(b = 0) near 1 would change dark pixels.

    Examples
    --------
    >>> is_bright(Sensor()), is_bright(Sensor(gain=25.0))
    (False, True)
    """
    efficiency, dark_counts = reference_jot(sensor)
    rate = efficiency * sensor.light_per_intensity * sensor.max_intensity + dark_counts
    return sensor.threshold == 1 and rate > _BRIGHT


def estimates_zeros(layers: Sequence[Layer], sensor: Sensor) -> bool:
    """Return whether the last of the layers has a spline, and the sensor is bright."""
    return layers[-1].coefficients is not None and is_bright(sensor)


def zero_layers(network: ConditionalNetwork, trials: int) -> tuple[Layer, ...]:
    """Return the layers for K = `trials`, from counts of ones to P(b = 0)."""
    *others, _ = network.conditioned_layers(trials)
    last, range_ = network.layers[-1], network.trials_range
    assert last.coefficients is not None, "see estimates_zeros"
    assert range_ is not None, "a K-conditioned network"
    # B-splines sum to 1, and so do the weights of the sets. So this is one minus the spline, and
    # near P(b = 1) = 1, no digit is lost.
    last = dataclasses.replace(last, coefficients=1 - last.coefficients)
    weights = conditioning_weights(trials, range_, count_sets(network.layers))
    return (*others, last.interpolate(weights))


@dataclasses.dataclass(frozen=True)
class ZerosNetwork:
    """A K-conditioned network from fractions of zeros to probabilities of a 0."""

    network: ConditionalNetwork
    halo: int
    """Radius of the receptive field in pixels."""

    @property
    def trials_range(self) -> tuple[int, int] | None:
        """Smallest and largest K."""
        return self.network.trials_range

    def denoise_probabilities(
        self, fractions: Sequence[Image], trials: int, *, threads: int | None = None
    ) -> list[Image]:
        """Return the probabilities P(b = 0) of images of fractions of zeros (H, W)."""
        sensor = Sensor(frames=trials)
        layers = zero_layers(self.network, trials)
        rotations = self.network.rotations
        inference = Inference(layers, sensor, reference_jot(sensor), threads, rotations)
        return inference.run_counts((1 - image) * np.float32(trials) for image in fractions)
