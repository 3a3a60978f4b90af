"""The response of each jot, and the dead jots, from a capture of even light."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.calibration.rates import Rates, detections, variance
from jotlight.checks import Counts
from jotlight.interrupts import interruptible
from jotlight.sensing.mosaic import Pattern
from jotlight.sensing.response import detection_probability

WINDOW = 15
"""Side of a window, in jots. Its median estimates the light on the jot at its center."""

MIN_RESPONSE = 0.2
"""Minimum response of a working jot relative to its neighborhood. The maximum is its inverse."""

OUTLIER = 4.0
"""A response at least this many standard deviations from 1 is an outlier: it is not shrunk.

`docs/results/calibration.md` has the measurement behind this number.
"""

_MIN_LIGHT = 0.1
"""Minimum light of a flat capture, in standard deviations of the measurement of one jot."""


@dataclasses.dataclass(frozen=True)
class Response:
    """The response of the jots relative to that of their neighborhood.

    Parameters
    ----------
    relative : ndarray of float64, shape (H, W)
        Around 1, within [1/5, 5]; 1 where it is unknown. Except for outliers, values are shrunk
        toward 1 according to their counting noise.
    dead : ndarray of bool, shape (H, W)
        Jots that respond too weakly or too strongly.
    prnu, prnu_error : float
        Standard deviation of the true response over the good jots except outliers, and its standard
        error. The variance of the counting noise is subtracted.
    noise : float
        Standard deviation of the counting noise in the response of one jot.
    """

    relative: Rates
    dead: npt.NDArray[np.bool_]
    prnu: float
    prnu_error: float
    noise: float


def measure_response(
    ones: Counts,
    frames: int,
    dark: Rates,
    dark_variance: Rates,
    bad: npt.NDArray[np.bool_],
    *,
    threshold: int,
    false_positive_rate: float,
    filters: Pattern | None = None,
) -> Response:
    """Return the response of each jot from a capture of even light.

    Light is assumed to vary slowly over the sensor. So the light on each jot is divided by the
    median over 15 x 15 jots, which also removes slow variations of the response. The quotient is r.
    Its counting noise has the variance v. If the response varies with the standard deviation PRNU,
    its best linear estimate is 1 + (r - 1) PRNU²/(PRNU² + v). For an outlier, the estimate is r.

    Parameters
    ----------
    ones, frames : ndarray of int, int
        L of each jot, and the number of frames.
    dark, dark_variance : ndarray of float64
        Dark counts per frame, and their variance.
    bad : ndarray of bool
        Jots to ignore.
    threshold : int
        q.
    false_positive_rate : float
        Maximum probability that a jot with 1/5 to 5 times the response of its neighborhood is
        called dead, from the exact binomial tail.
    filters : ndarray of int, shape (H, W), optional
        The place of the color filter of each jot. The light on a jot is first divided by the median
        light behind its filter, so that the jots of all filters show the same light.
    """
    from scipy.stats import binom

    full = ones >= frames
    if full[~bad].mean() > 0.5:
        raise ValueError(
            f"flat: expected a capture with light that leaves some bits 0, but most jots report 1 "
            f"in all {frames} frames; record it with less light"
        )
    light = detections(ones, frames, threshold) - dark
    passed = _light_behind(filters, light, bad)
    local = passed * _local_median(light / passed, bad)
    counting = variance(local + dark, frames, threshold) + dark_variance
    if not np.median(local[~bad]) > _MIN_LIGHT * np.sqrt(np.median(counting[~bad])):
        raise ValueError(
            "flat: expected more ones than in the dark capture, got no more; record it with light "
            "and with the exposure of the dark capture"
        )
    local = np.maximum(local, 1e-3 * np.median(local[~bad]))
    weak = detection_probability(threshold, MIN_RESPONSE * local + dark)
    strong = detection_probability(threshold, local / MIN_RESPONSE + dark)
    dead = binom.cdf(ones, frames, weak) <= false_positive_rate
    dead |= binom.sf(ones - 1, frames, strong) <= false_positive_rate

    good = ~(bad | dead | full)
    counting /= local**2
    if not good.any():
        raise ValueError("flat: expected some jots that respond, got none")
    relative = np.ones(light.shape)
    relative[good], prnu, error = shrink_response((light / local)[good], counting[good])
    relative = np.clip(relative, MIN_RESPONSE, 1 / MIN_RESPONSE)
    return Response(relative, dead, prnu, error, float(np.sqrt(counting[good].mean())))


def shrink_response(
    relative: Rates, noise: Rates, outlier: float = OUTLIER
) -> tuple[Rates, float, float]:
    """Return responses shrunk toward 1, their noise-free standard deviation, and its error.

    Parameters
    ----------
    relative, noise : ndarray of float64
        The measured response of each jot, and the variance of its counting noise.
    outlier : float
        A response more than this many standard deviations, including noise, from 1 is not shrunk.
    """
    squares = (relative - np.median(relative)) ** 2
    # The median ignores outliers. For a normal distribution it is 0.6745 σ.
    between = max(float(np.median(squares)) / 0.6745**2 - float(np.median(noise)), 0.0)
    ordinary = squares <= outlier**2 * (between + noise)
    between = max(float((squares - noise)[ordinary].mean()), 0.0)
    error = float(squares[ordinary].std()) / np.sqrt(ordinary.sum())
    # The error of a variance becomes that of its square root, which is not linear at 0.
    error = min(error / (2 * np.sqrt(between)), np.sqrt(error)) if between else np.sqrt(error)
    weight = between / (between + noise)
    weight[(relative - 1) ** 2 > outlier**2 * (between + noise)] = 1.0
    return 1 + (relative - 1) * weight, float(np.sqrt(between)), float(error)


def _light_behind(filters: Pattern | None, light: Rates, bad: npt.NDArray[np.bool_]) -> Rates:
    """Return the median light behind the filter of each jot, (H, W); 1 for a gray sensor."""
    passed = np.ones(light.shape)
    if filters is None:
        return passed
    for index in np.unique(filters):
        own = filters == index
        if not (own & ~bad).any():
            raise ValueError(
                f"dark: expected good jots behind each color filter, but all {own.sum()} jots "
                f"behind filter {index} of the mosaic are hot"
            )
        usual = float(np.median(light[own & ~bad]))
        if usual <= 0:
            raise ValueError(
                f"flat: expected light behind each color filter, got none on the {own.sum()} jots "
                f"behind filter {index} of the mosaic; use white light"
            )
        passed[own] = usual
    return passed


def _local_median(light: Rates, bad: npt.NDArray[np.bool_]) -> Rates:
    """Return the median around each jot. The median of a first pass replaces bad jots."""
    from scipy.ndimage import median_filter

    side = tuple(min(WINDOW, size - 1 + size % 2) for size in light.shape)
    first = np.where(bad, np.median(light[~bad]), light)
    median = interruptible(median_filter)
    first = median(first, size=side, mode="reflect")
    return np.asarray(median(np.where(bad, first, light), size=side, mode="reflect"))
