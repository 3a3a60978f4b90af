"""The warnings about estimates that the largest intensity clips."""

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.evaluation.choice import Choice
from jotlight.networks.pretrained import DEFAULT_SIZE
from jotlight.sensing.merged import MERGE_AGAIN, Merged
from jotlight.sensing.reference import saturation_intensity
from jotlight.sensing.sensor import Sensor

_PIXELS_AT_ONCE = 1 << 18
"""Number of pixels that are compared in one call of NumPy."""

_MAX_CLIPPED = 0.9
"""Fraction of pixels at the largest intensity above which a warning is issued."""

_NEAR_LARGEST = 0.98
"""Fraction of the largest intensity of a network above which an estimate counts as clipped."""


def largest_colors(sensor: Sensor) -> npt.NDArray[np.float32]:
    """Return the largest intensity of an estimate, which a mosaic multiplies by its white balance.

    Examples
    --------
    >>> largest_colors(Sensor(max_intensity=2)).tolist()
    2.0
    >>> from jotlight.sensing.mosaic import Mosaic
    >>> mosaic = Mosaic("RGGB", white_balance=[1.5, 1, 2])
    >>> largest_colors(Sensor(mosaic=mosaic)).tolist()
    [1.5, 1.0, 2.0]
    """
    factors = 1 if sensor.mosaic is None else sensor.mosaic.white_balance
    return np.asarray(sensor.max_intensity * factors, np.float32)


def warn_about_clipping(
    estimate: npt.NDArray[np.float32], sensor: Sensor, data: Iterable[object] = ()
) -> None:
    """Warn if the largest intensity clips most pixels, although the bits are not saturated.

    Equivalent counts among the data are not valid beyond an intensity, and do not say whether their
    readings are saturated.
    """
    valid = min((one.valid_up_to for one in data if isinstance(one, Merged)), default=math.inf)
    saturation, highest = min(saturation_intensity(sensor), valid), largest_colors(sensor)
    must_merge = valid <= sensor.max_intensity
    if saturation <= sensor.max_intensity and not must_merge:
        return
    # In parts: new memory for a large image takes longer than the comparison.
    number = max(1, _PIXELS_AT_ONCE * len(estimate) // estimate.size)
    parts = (estimate[start : start + number] for start in range(0, len(estimate), number))
    clipped = sum(np.count_nonzero(part >= highest) for part in parts) / estimate.size
    if clipped <= _MAX_CLIPPED:
        return
    balance = " times the white balance" if np.any(highest != sensor.max_intensity) else ""
    advice = (
        f"up to which the equivalent counts are valid; unless all readings are saturated, "
        f"{MERGE_AGAIN}"
        if must_merge
        else f"although the bits saturate only at {saturation:.3g}; "
        f"sensor.replace(max_intensity={saturation:.3g}) (--max-intensity) lets them be brighter"
    )
    warn(
        f"{clipped:.0%} of the pixels have the largest intensity, {sensor.max_intensity:g}"
        f"{balance}, {advice}"
    )


def clipping_of(choice: Choice, maximum: float) -> str | None:
    """Return a remark if a network is for smaller intensities than those of the scene, or None.

    Parameters
    ----------
    choice : Choice
        Method of the estimate.
    maximum : float
        Largest value of the estimate.

    Examples
    --------
    >>> from jotlight.evaluation.choice import choose_method
    >>> choice = choose_method(Sensor(frames=16), requested="network-small", is_range_known=False)
    >>> clipping_of(choice, 0.9) is None
    True
    >>> clipping_of(choice, 1.0)
    'the scene reaches the largest intensity 1 of the network, so brighter pixels are clipped; ...'
    """
    if choice.saturation is None or maximum <= _NEAR_LARGEST * choice.max_intensity:
        return None
    return (
        f"the scene reaches the largest intensity {choice.max_intensity:g} of the network, so "
        f'brighter pixels are clipped; quality="{DEFAULT_SIZE}" (--quality {DEFAULT_SIZE}) reaches '
        f"{choice.saturation:.3g}, where the bits saturate"
    )
