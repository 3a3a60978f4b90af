"""Sums over jots along a motion as the merged counts of pixels."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.motion.agreement.consistency import Consistent
from jotlight.motion.counts.jots import SeenJots
from jotlight.motion.counts.sums import Sums
from jotlight.motion.motion import Motion
from jotlight.motion.posterior import posterior_error
from jotlight.sensing.bits.channels import stack_channels
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor
from jotlight.squares import mean_squares, repeat_squares

_MIN_FLAGGED = 0.5
"""Fraction of the jots of a pixel that are flagged, above which the pixel is."""


class MergedAlong(NamedTuple):
    """What is merged along a motion."""

    merged: Merged
    """The counts of the pixels, and their flags."""
    window: range | None
    """The frames of the window without motion that replaced it, or None."""
    flagged: float
    """Fraction of the pixels that the bits flag (:mod:`jotlight.motion.agreement.flags`).

    The flags of the image also mark where errors are expected.
    """
    agreeing: float
    """Fraction of the bits that agree with the motion by the usual test. Fewer may be counted."""
    counted: Consistent
    """The sums of the bits along the motion that are counted, unless a window replaced them."""


def as_merged(
    channels: list[Sums],
    accepted: npt.NDArray[np.float32],
    flags: npt.NDArray[np.bool_],
    motion: Motion,
    sensor: Sensor,
    *,
    color: bool = False,
) -> Merged:
    """Return sums over jots as the merged counts of pixels, as :func:`as_pixels` does."""
    side = sensor.oversampling
    return as_pixels(
        channels,
        sensor,
        color=color,
        acceptance=_mean_of_pixels(accepted, side),
        posterior_error=_mean_of_pixels(posterior_error(motion), side),
        flags=_mean_of_pixels(flags.astype(np.float32), side) >= _MIN_FLAGGED,
    )


def as_pixels(
    channels: list[Sums], sensor: Sensor, *, color: bool = False, **others: Any
) -> Merged:
    """Return sums over jots as the counts of pixels, with other parameters of :class:`Merged`.

    For color images, the counts have an axis of channels, which may have the length 1.
    """
    side = sensor.oversampling
    efficiency, dark_counts = _seen_jots(channels[0], sensor, side)
    return Merged(
        stack_channels([_sum_pixels(each.ones, side) for each in channels], color=color),
        stack_channels(
            [_sum_pixels(each.trials, side).astype(np.float64) for each in channels], color=color
        ),
        sensor,
        dark_counts=dark_counts,
        efficiency=efficiency,
        channel_axis=-1 if color else None,
        **others,
    )


def as_fine(
    channels: list[Sums],
    accepted: npt.NDArray[np.float32],
    flags: npt.NDArray[np.bool_],
    motion: Motion,
    sensor: Sensor,
    *,
    color: bool = False,
) -> Merged:
    """Return sums on the fine grid as merged counts. The error is in pixels of this grid."""
    return as_pixels(
        channels,
        sensor,
        color=color,
        acceptance=repeat_squares(accepted, 2),
        posterior_error=2 * repeat_squares(posterior_error(motion), 2),
        flags=repeat_squares(flags, 2),
        upsample=2,
    )


def _seen_jots(sums: Sums, sensor: Sensor, side: int) -> tuple[float | Array, float | Array]:
    """Return the efficiency and the dark counts behind each pixel of side x side jots.

    They are maps of what :class:`Merged` states, or numbers if all jots are alike.
    """
    if sums.jots is None:
        return reference_jot(sensor)
    # For q = 1, not the dark counts are averaged but exp(-d), so all jots of a pixel are averaged
    # at once.
    of_pixels = np.stack([_sum_pixels(each, side) for each in sums.jots.sums])
    seen = SeenJots(sums.jots.jots, of_pixels)
    efficiency, dark_counts = seen.mean(_sum_pixels(sums.trials, side)).astype(np.float64)
    return np.minimum(efficiency, 1), dark_counts  # rounding errors may exceed 1


def _sum_pixels(values: npt.NDArray[Any], side: int) -> npt.NDArray[Any]:
    """Return the sums over the jots of each pixel, of the same type."""
    height, width = values.shape
    blocks = values.reshape(height // side, side, width // side, side)
    return np.ascontiguousarray(blocks.sum(axis=(1, 3), dtype=values.dtype))


def _mean_of_pixels(values: npt.NDArray[np.float32], side: int) -> npt.NDArray[np.float32]:
    """Return the means over the jots of each pixel."""
    return np.asarray(mean_squares(values, side, np.float64), np.float32)


def mean_map(merged: Sequence[Merged], name: str) -> npt.NDArray[np.float64]:
    """Return the mean of a map, or of a number for all pixels, over merged counts of one shape."""
    maps = [np.broadcast_to(getattr(each, name), each.shape) for each in merged]
    return np.asarray(np.mean(maps, axis=0, dtype=np.float64))
