"""The warning about estimates that the largest intensity clips."""

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.sensing.reference import saturation_intensity
from jotlight.sensing.sensor import Sensor

_PIXELS_AT_ONCE = 1 << 18
"""Number of pixels that are compared in one call of NumPy."""

_MAX_CLIPPED = 0.9
"""Fraction of pixels at the largest intensity above which a warning is issued."""


def warn_about_clipping(estimate: npt.NDArray[np.float32], sensor: Sensor) -> None:
    """Warn if the largest intensity clips most pixels, although the bits are not saturated."""
    saturation, highest = saturation_intensity(sensor), np.float32(sensor.max_intensity)
    if saturation <= sensor.max_intensity:
        return
    # In parts: new memory for a large image takes longer than the comparison.
    number = max(1, _PIXELS_AT_ONCE * len(estimate) // estimate.size)
    parts = (estimate[start : start + number] for start in range(0, len(estimate), number))
    clipped = sum(np.count_nonzero(part >= highest) for part in parts) / estimate.size
    if clipped > _MAX_CLIPPED:
        warn(
            f"{clipped:.0%} of the pixels have the largest intensity, {sensor.max_intensity:g}, "
            f"although the bits saturate only at {saturation:.3g}; "
            f"sensor.replace(max_intensity={saturation:.3g}) (--max-intensity) lets them be "
            "brighter"
        )
