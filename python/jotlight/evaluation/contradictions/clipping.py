"""The warnings about estimates that the largest intensity clips."""

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np
import numpy.typing as npt

from jotlight.errors import hide_warnings, warn
from jotlight.evaluation.choice import Choice
from jotlight.networks.pretrained import DEFAULT_SIZE
from jotlight.sensing.likelihood.reference import saturation_intensity
from jotlight.sensing.merged import MERGE_AGAIN, Merged
from jotlight.sensing.sensor import Sensor

_PIXELS_AT_ONCE = 1 << 18
"""Number of pixels that are compared in one call of NumPy."""

_MAX_CLIPPED = 0.9
"""Fraction of values that may be clipped where the data do not show which of them are too dark."""

_BRIGHTER = "brighter than the largest intensity"

_NEAR_LARGEST = 0.98
"""Fraction of the largest intensity of a network above which an estimate counts as clipped."""


def largest_colors(sensor: Sensor) -> npt.NDArray[np.float32]:
    """Return the largest intensity of an estimate, which a mosaic multiplies by its white balance.

    Examples
    --------
    >>> largest_colors(jl.Sensor(max_intensity=2)).tolist()
    2.0
    >>> from jotlight.sensing.parameters.mosaic import Mosaic
    >>> mosaic = Mosaic("RGGB", white_balance=[1.5, 1, 2])
    >>> largest_colors(jl.Sensor(mosaic=mosaic)).tolist()
    [1.5, 1.0, 2.0]
    """
    factors = 1 if sensor.mosaic is None else sensor.mosaic.white_balance
    return np.asarray(sensor.max_intensity * factors, np.float32)


def warn_about_clipping(
    values: npt.NDArray[np.float32],
    sensor: Sensor,
    bright: Callable[[], npt.NDArray[np.bool_] | None],
    data: Iterable[object] = (),
) -> None:
    """Warn if a pixel is brighter than the largest intensity, which clips its estimate.

    Parameters
    ----------
    values : ndarray of float32
        The estimate, or the upper ends of its intervals.
    sensor : Sensor
        The sensor of the data.
    bright : callable
        A function that returns which pixels the data show to be brighter
        (:mod:`jotlight.evaluation.contradictions.bright_pixels`), or None if they cannot
        show it. The warning then needs 90 % clipped values. The function is called only if a value
        is clipped.
    data : iterable
        The data. Equivalent counts among them are not valid beyond an intensity, and do not say
        whether their readings are saturated.
    """
    valid = min((one.valid_up_to for one in data if isinstance(one, Merged)), default=math.inf)
    saturation, highest = min(saturation_intensity(sensor), valid), largest_colors(sensor)
    must_merge = valid <= sensor.max_intensity
    if saturation <= sensor.max_intensity and not must_merge:
        return
    # In parts: new memory for a large image takes longer than the comparison.
    step = max(1, _PIXELS_AT_ONCE * len(values) // values.size)
    parts = (values[start : start + step] for start in range(0, len(values), step))
    clipped = sum(np.count_nonzero(part >= highest) for part in parts)
    if not clipped:
        return
    number, size = clipped, values.size
    if (known := bright()) is not None:
        number, size = np.count_nonzero(known), known.size
    if not number or (known is None and clipped <= _MAX_CLIPPED * size):
        return
    limit = f"{saturation:.3g}"
    balance = " times the white balance" if np.any(highest != sensor.max_intensity) else ""
    advice = (
        f"; the equivalent counts are not valid beyond it, so unless all readings are saturated, "
        f"{MERGE_AGAIN}"
        if must_merge
        else f", although the bits saturate only at {limit}; "
        f"sensor.replace(max_intensity={limit}) (--max-intensity {limit}) lets them be brighter"
    )
    warn(
        f"{number:,} of {size:,} pixels {'is' if number == 1 else 'are'} {_BRIGHTER}, "
        f"{sensor.max_intensity:g}{balance}, which clips the estimate{advice}"
    )


@contextlib.contextmanager
def with_clipping_of(choice: Choice) -> Iterator[None]:
    """Hide the warning about bright scenes where :func:`clipping_of` has a better remark.

    Examples
    --------
    >>> from jotlight.evaluation.choice import choose_method
    >>> with with_clipping_of(choose_method(jl.Sensor(frames=16))):
    ...     pass
    """
    with hide_warnings(_BRIGHTER) if choice.saturation is not None else contextlib.nullcontext():
        yield


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
    >>> sensor = jl.Sensor(frames=16)
    >>> choice = choose_method(sensor, requested="network-small", is_range_known=False)
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
