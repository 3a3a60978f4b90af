"""What is known about the errors of an estimate before they become intervals."""

import dataclasses

import numpy as np

from jotlight.array_types import Array, Image
from jotlight.evaluation.intervals.error_scale import ErrorModel, HalfErrors

TYPICAL_DEVIATION = 1.4
"""Root mean square of error/scale on photographs."""

_WINDOW = 7
"""Side of the window in which two estimates are compared, in pixels."""


@dataclasses.dataclass(frozen=True, eq=False)
class KnownErrors:
    """What is known about the errors of an estimate."""

    estimate: Image
    """The network's estimate, (H, W), which states the class of each pixel."""
    scale: Array
    """The scale of the errors, (H, W)."""
    halves: list[HalfErrors]
    """The errors of the estimates from each half of the bits, if there are any."""
    model: ErrorModel

    def widened(self, difference: Array) -> "KnownErrors":
        """Return the errors of another estimate, whose z differs from that of the network's.

        The error of a network that minimizes the squared error is nearly orthogonal to every
        function of the data, and so to the difference. So the squares add up.
        """
        from scipy.ndimage import uniform_filter

        squared = uniform_filter(difference**2, _WINDOW, mode="mirror")
        scale = np.sqrt(self.scale**2 + squared / TYPICAL_DEVIATION**2)
        return dataclasses.replace(self, scale=np.asarray(scale))

    def at_least(self, squared: Array) -> "KnownErrors":
        """Return the errors if the squared errors of z are known to be at least as large, (H, W).

        Examples
        --------
        >>> from jotlight.evaluation.intervals.error_scale import error_model
        >>> estimate, scale = np.zeros((1, 2), np.float32), np.full((1, 2), 0.1)
        >>> known = KnownErrors(estimate, scale, [], error_model())
        >>> known.at_least(np.array([[0.0, 0.49]])).scale
        array([[0.1, 0.5]])
        """
        scale = np.maximum(self.scale, np.sqrt(squared) / TYPICAL_DEVIATION)
        return dataclasses.replace(self, scale=scale)
