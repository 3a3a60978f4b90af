"""The response of each jot, and the dead jots, from a capture of even light."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Pattern
from jotlight.calibration.agreement import warn_about_different_captures
from jotlight.calibration.dead_jots import MIN_RESPONSE, find_dead_jots
from jotlight.calibration.evenness import warn_about_light
from jotlight.calibration.jot_counts import JotCounts
from jotlight.calibration.light import excess_and_slope, mean_light, median_light, window_mean
from jotlight.calibration.outliers import OUTLIER, find_outliers
from jotlight.calibration.prnu import measure_prnu
from jotlight.sensing.parameters.response import detection_density

_MIN_LIGHT = 0.1
"""Minimum light of a flat capture, in standard deviations of the measurement of one jot."""

_NO_ZEROS = 700.0
"""Dark counts per frame of a jot without zeros, for which exp(-d) is almost 0, and d is finite."""


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

    relative: Array
    dead: npt.NDArray[np.bool_]
    prnu: float
    prnu_error: float
    noise: float


def measure_response(
    flat: JotCounts,
    dark: JotCounts,
    bad: npt.NDArray[np.bool_],
    *,
    false_positive_rate: float,
    filters: Pattern | None = None,
) -> Response:
    """Return the response of each jot from a capture of even light.

    Light is assumed to vary slowly over the sensor. So the light on each jot is divided by that of
    the surrounding 15 x 15 jots, which also removes slow variations of the response. The quotient
    is r. Its counting noise has the variance v. If the response varies with the standard deviation
    PRNU, its best linear estimate is 1 + (r - 1) PRNU²/(PRNU² + v). For an outlier, the estimate is
    r.

    Parameters
    ----------
    flat, dark : JotCounts
        The counts with light, and without.
    bad : ndarray of bool
        Hot jots to ignore.
    false_positive_rate : float
        Maximum probability that a jot with 1/5 to 5 times the response of its neighborhood is
        called dead: see :func:`jotlight.calibration.dead_jots.find_dead_jots`.
    filters : ndarray of int, shape (H, W), optional
        The place of the color filter of each jot.
    """
    full = flat.ones >= flat.frames
    _check_ones(full[~bad], flat.frames)
    dark_counts = dark.detections()
    light = flat.detections() - dark_counts
    start = median_light(light, bad, filters)
    dark_variance = dark.variance(dark_counts)
    counting = flat.variance(start + dark_counts) + dark_variance
    if not np.median(start[~bad]) > _MIN_LIGHT * np.sqrt(np.median(counting[~bad])):
        raise ValueError(
            "flat: expected more ones than in the dark capture, got no more; record it with light "
            "and with the exposure of the dark capture"
        )
    start = np.maximum(start, 1e-3 * np.median(start[~bad]))
    warn_about_different_captures(flat, dark_counts, start, bad, false_positive_rate)
    # A jot with a one in each dark frame shows nothing, and half a one less would be wrong.
    fitted = np.where(dark.ones >= dark.frames, _NO_ZEROS, dark_counts)
    noise = _counting_noise(flat, dark, start, bad)
    used = _ordinary(*excess_and_slope(flat, fitted, start), light / start - 1, noise, ~bad)
    found = mean_light(flat, fitted, start, used, filters)
    dead = find_dead_jots(flat, dark, found, false_positive_rate)
    warn_about_light(found, light / start, ~bad, gray=filters is None)
    working = ~(bad | dead)
    good = working & ~full
    if not good.any():
        raise ValueError("flat: expected some jots that respond, got none")
    counting = flat.variance(found.light + dark_counts) + dark_variance
    counting /= found.light**2
    noise = _counting_noise(flat, dark, found.light, bad)
    used = (found.neighbors > 1) & _ordinary(
        found.excess, found.slope, light / found.light - 1, noise, working
    )
    prnu, error = measure_prnu(found, noise, used, dark_counts, flat.threshold)
    relative = np.ones(light.shape)
    measured, noise = (light / found.light)[good], counting[good]
    counted = dataclasses.replace(flat, ones=flat.ones[good])
    outliers = find_outliers(counted, dark_counts[good], found.light[good], measured, noise, prnu)
    relative[good] = shrink_response(measured, noise, prnu**2, outliers)
    relative = np.clip(relative, MIN_RESPONSE, 1 / MIN_RESPONSE)
    return Response(relative, dead, prnu, error, float(np.sqrt(noise.mean())))


def _check_ones(full: npt.NDArray[np.bool_], frames: int) -> None:
    """Raise ValueError unless the counts distinguish responses. `full` ones are all ones."""
    if frames < 2:
        raise ValueError(
            "flat: expected 2 frames or more, since one does not distinguish the response of a "
            "jot from chance, got 1; record more frames"
        )
    if full.mean() > 0.5:
        raise ValueError(
            f"flat: expected a capture with light that leaves some bits 0, but most jots report 1 "
            f"in all {frames} frames; record it with less light"
        )


def shrink_response(
    relative: Array, noise: Array, between: float, outliers: npt.NDArray[np.bool_]
) -> Array:
    """Return responses shrunk toward 1.

    Parameters
    ----------
    relative, noise : ndarray of float64
        The measured response of each jot, and the variance of its counting noise.
    between : float
        Variance of the true response over the jots.
    outliers : ndarray of bool
        The jots whose responses are not shrunk.
    """
    return 1 + (relative - 1) * np.where(outliers, 1.0, between / (between + noise))


def _ordinary(
    excess: Array, slope: Array, deviation: Array, noise: Array, known: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Return the known jots that are no outliers.

    An outlier deviates by more than `OUTLIER` standard deviations in its excess of ones and in its
    response, `deviation` + 1. The first one is skew where responses differ much, and the second one
    where a jot has few zeros.
    """
    squares = excess**2
    # The median ignores outliers. For a normal distribution it is 0.6745 σ.
    usual = float(np.median(squares[known])) / 0.6745**2 - float(np.median(noise[known]))
    between = max(usual, 0.0) / max(float(np.median(slope[known])) ** 2, 1e-300)
    # The noise of a jot is estimated from its count. Without zeros it would be 0.
    noise = np.maximum(noise, window_mean(noise, known))
    squares = np.minimum(squares, (slope * deviation) ** 2)
    return np.asarray(known & (squares <= OUTLIER**2 * (between * slope**2 + noise)))


def _counting_noise(
    flat: JotCounts, dark: JotCounts, light: Array, bad: npt.NDArray[np.bool_]
) -> Array:
    """Return the variance of L/T - P(q, d + light), estimated from the counts of each jot.

    The variance of L/T is exactly the mean of (L/T)(1 - L/T)/(T - 1), whatever the response is.
    For q = 1, P is linear in the L/T of the dark capture, so the same holds for its part. Otherwise
    that part is known to first order, and is no more than the scatter of d over the jots.
    """
    of_flat, of_dark = (
        each.fractions * (1 - each.fractions) / max(each.frames - 1, 1) for each in (flat, dark)
    )
    if flat.threshold == 1:
        return np.asarray(of_flat + np.exp(-2 * light) * of_dark)
    rates = dark.detections()
    of_dark = np.minimum(dark.variance(rates), rates[~bad].var())
    return np.asarray(of_flat + detection_density(flat.threshold, rates + light) ** 2 * of_dark)
