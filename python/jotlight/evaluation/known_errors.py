"""What is known about the errors of an estimate before they become intervals."""

import dataclasses

import numpy as np

from jotlight.evaluation.error_scale import ErrorModel, HalfErrors
from jotlight.sensing.pixel_counts import Estimate
from jotlight.sensing.response import Array

TYPICAL_DEVIATION = 1.4
"""Root mean square of error/scale on photographs."""

_WINDOW = 7
"""Side of the window in which two estimates are compared, in pixels."""


@dataclasses.dataclass(frozen=True, eq=False)
class KnownErrors:
    """What is known about the errors of an estimate."""

    estimate: Estimate
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
