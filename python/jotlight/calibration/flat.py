"""What an evenly lit capture tells: the response of each jot, and jots that have none."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.calibration.rates import Counts, Rates, detections, variance
from jotlight.sensing.response import detection_probability

LOCAL = 15
"""Side of the window, in jots, whose median is the light that falls on its middle."""

LEAST_RESPONSE = 0.2
"""Share of the response of its neighbourhood below which a jot is dead, and above whose inverse
it is stuck."""

CLEAR = 4.0
"""Standard deviations from 1 beyond which a response is taken as it was counted: measured, see
docs/guide/calibration.md."""

_LEAST_LIGHT = 0.1
"""Of the light in a flat capture, in standard deviations of one jot."""


@dataclasses.dataclass(frozen=True)
class Response:
    """The response of the jots relative to that of their neighbourhood.

    Parameters
    ----------
    relative : ndarray of float64, shape (H, W)
        Around 1, within [1/5, 5]; 1 where it is not known. Drawn towards 1 as far as counting blurs
        it, unless it is clearly another.
    dead : ndarray of bool, shape (H, W)
        Jots that respond too little or too much.
    prnu, prnu_error : float
        Standard deviation of the response among good jots that are not clear outliers, without
        that of counting, and its standard error.
    noise : float
        The standard deviation that counting adds to the response of a jot.
    """

    relative: Rates
    dead: npt.NDArray[np.bool_]
    prnu: float
    prnu_error: float
    noise: float


def response(
    ones: Counts,
    frames: int,
    dark: Rates,
    dark_variance: Rates,
    bad: npt.NDArray[np.bool_],
    *,
    threshold: int,
    false_positive_rate: float,
) -> Response:
    """Find the response of each jot from a capture of even light.

    Light is taken to vary slowly over the sensor: the median over 15 x 15 jots is divided out, and
    with it whatever of the response varies as slowly. What is left, r with variance v by counting,
    is drawn towards 1: the best linear estimate of a response that varies by PRNU is
    1 + (r - 1) PRNU²/(PRNU² + v), so that the map brings less noise than it takes away. A jot that
    is further off than most could be is not one of those that vary by PRNU, and keeps its r.

    Parameters
    ----------
    ones, frames : ndarray of int, int
        L of each jot, and out of how many frames.
    dark, dark_variance : ndarray of float64
        Dark counts per frame, and the variance with which they are known.
    bad : ndarray of bool
        Jots that are not looked at.
    threshold : int
        q.
    false_positive_rate : float
        The share, at most, of jots with 1/5 to 5 times the response of their neighbourhood that
        are called dead, by the exact binomial tail.
    """
    from scipy.stats import binom

    full = ones >= frames
    if full[~bad].mean() > 0.5:
        raise ValueError(
            f"flat: expected a capture with light that leaves some bits 0, but most jots fired in "
            f"all {frames} frames; take it with less light"
        )
    light = detections(ones, frames, threshold) - dark
    local = _local_median(light, bad)
    counting = variance(local + dark, frames, threshold) + dark_variance
    if not np.median(local[~bad]) > _LEAST_LIGHT * np.sqrt(np.median(counting[~bad])):
        raise ValueError(
            "flat: expected more ones than the dark capture has, got none; take it with light, "
            "and with the exposure of the dark capture"
        )
    local = np.maximum(local, 1e-3 * np.median(local[~bad]))
    weak = detection_probability(threshold, LEAST_RESPONSE * local + dark)
    strong = detection_probability(threshold, local / LEAST_RESPONSE + dark)
    dead = binom.cdf(ones, frames, weak) <= false_positive_rate
    dead |= binom.sf(ones - 1, frames, strong) <= false_positive_rate

    good = ~(bad | dead | full)
    counting /= local**2
    if not good.any():
        raise ValueError("flat: expected some jots that respond, got none")
    relative = np.ones(light.shape)
    relative[good], prnu, error = drawn_in((light / local)[good], counting[good])
    relative = np.clip(relative, LEAST_RESPONSE, 1 / LEAST_RESPONSE)
    return Response(relative, dead, prnu, error, float(np.sqrt(counting[good].mean())))


def drawn_in(relative: Rates, noise: Rates, clear: float = CLEAR) -> tuple[Rates, float, float]:
    """Responses drawn towards 1, their standard deviation without noise, and its standard error.

    Parameters
    ----------
    relative, noise : ndarray of float64
        The response of each jot as it was counted, and the variance that counting adds to it.
    clear : float
        Standard deviations from 1, noise included, beyond which a response stays as it is.
    """
    squares = (relative - np.median(relative)) ** 2
    # At first from the median, which outliers do not pull at: 0.6745 σ of a normal distribution.
    between = max(float(np.median(squares)) / 0.6745**2 - float(np.median(noise)), 0.0)
    ordinary = squares <= clear**2 * (between + noise)
    between = max(float((squares - noise)[ordinary].mean()), 0.0)
    error = float(squares[ordinary].std()) / np.sqrt(ordinary.sum())
    # Where nothing is left above the noise, the error is that of the variance itself.
    error = min(error / (2 * np.sqrt(between)), np.sqrt(error)) if between else np.sqrt(error)
    kept = between / (between + noise)
    kept[(relative - 1) ** 2 > clear**2 * (between + noise)] = 1.0
    return 1 + (relative - 1) * kept, float(np.sqrt(between)), float(error)


def _local_median(light: Rates, bad: npt.NDArray[np.bool_]) -> Rates:
    """The median of the jots around each, bad ones left out as well as a filter can."""
    from scipy.ndimage import median_filter

    side = tuple(min(LOCAL, size - 1 + size % 2) for size in light.shape)
    first = np.where(bad, np.median(light[~bad]), light)
    first = median_filter(first, size=side, mode="reflect")
    return np.asarray(median_filter(np.where(bad, first, light), size=side, mode="reflect"))
