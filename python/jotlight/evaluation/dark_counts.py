"""The warning about dark counts that the data contradict."""

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.sensing.pixel_counts import GrayImages, PixelCounts
from jotlight.sensing.response import detection_probability
from jotlight.sensing.sensor import Sensor

_CLEARLY = 1.25
"""Dark counts that cause this many times the ones of the mean pixel are compared."""

_MIN_SHARE, _MIN_SHARE_OF_MAP = 0.8, 0.5
"""Smallest fraction of the ones caused by dark counts that the data show if these are right: if
they are a number, and if they are a map. The largest values of a map are too large by chance."""

_MIN_EXPECTED = 1000.0
"""Smallest number of ones that the dark counts must cause. By Chernoff's bound, those of a number
that is right fall below 80 % of it with a probability of exp(-0.2² · 1000 / 2) = 2e-9 or less."""


def warn_about_dark_counts(images: GrayImages, sensor: Sensor, threads: int | None = None) -> None:
    """Warn if bits have far fewer ones than the dark counts of their sensor cause without light.

    Readings that differ, and pixels whose jots differ, are not compared.
    """
    if not np.any(sensor.dark_counts) or not sensor.has_plain_bits or sensor.mosaic is not None:
        return
    smallest = _MIN_SHARE if np.ndim(sensor.dark_counts) == 0 else _MIN_SHARE_OF_MAP
    for part in images.parts(sensor):
        pixels = part.count(sensor, threads)
        if pixels.varies_within_pixels or (share := _share_of_ones(pixels, sensor)) is None:
            return
        if share < smallest:
            warn(
                f"dark_counts: the data have {share:.0%} of the ones that these dark counts cause "
                "without light, so they are wrong; they are numbers per jot and frame, so counts "
                "of a dark capture are divided by its number of frames, as in jotlight.calibrate"
            )
            return


def _share_of_ones(pixels: PixelCounts, sensor: Sensor) -> float | None:
    """Return the ones of pixels with many dark counts, divided by those that these cause.

    The result is None without such pixels, or with too few ones to tell.
    """
    trials: npt.NDArray[np.float64] = np.broadcast_to(pixels.trials, pixels.counts.shape)
    dark = detection_probability(int(sensor.threshold), np.float64(pixels.dark_counts))
    brightness = pixels.counts.sum() / max(float(trials.sum()), 1.0)
    is_darker = np.broadcast_to(dark > _CLEARLY * brightness, trials.shape)
    expected = float((trials * dark)[is_darker].sum())
    if expected < _MIN_EXPECTED:
        return None
    return float(pixels.counts[is_darker].sum()) / expected
