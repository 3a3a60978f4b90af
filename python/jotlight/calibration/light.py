"""The light on each jot in a capture of even light."""

import dataclasses

import numpy as np

from jotlight.array_types import Array, Mask, Pattern
from jotlight.calibration.jot_counts import JotCounts
from jotlight.interrupts import interruptible
from jotlight.sensing.parameters.response import detection_density, detection_probability

WINDOW = 15
"""Side of a window, in jots. Its jots estimate the light on the jot at its center."""

_STEPS = 4
"""Steps of Newton's method from the median to the mean of a window. They agree to a few percent."""

_MAX_STEP = 0.5
"""Maximum relative change of the light behind a filter in a step."""

_MIN_SLOPE = 1e-12
"""Minimum sum of the slopes of jots that reveal the light."""


@dataclasses.dataclass(frozen=True)
class LocalLight:
    """The light on each jot, from its window. All maps have the shape (H, W).

    Parameters
    ----------
    light : ndarray of float64
        Detected photons per frame of a jot of ordinary response.
    shown : ndarray of float64
        The light before the color filters, in any unit. For a gray sensor, it is `light`.
    error : ndarray of float64
        Standard error of the light.
    excess : ndarray of float64
        L/T - P(q, d + light): how many more ones per frame a jot reports than with the ordinary
        response.
    slope : ndarray of float64
        How many more ones per frame it reports with the relative response 1 + x, divided by x, for
        small x.
    neighbors : ndarray of float64
        Number of jots in the window from which the light is known.
    """

    light: Array
    shown: Array
    error: Array
    excess: Array
    slope: Array
    neighbors: Array


def median_light(light: Array, bad: Mask, filters: Pattern | None) -> Array:
    """Return the median of the measured light around each jot, or among those of its filter.

    The light on a jot is first divided by the median light behind its filter, so that the jots of
    all filters show the same light.
    """
    passed = _light_behind(filters, light, bad)
    return passed * _local_median(light / passed, bad)


def mean_light(
    flat: JotCounts, dark: Array, start: Array, used: Mask, filters: Pattern | None
) -> LocalLight:
    """Return the light with which the jots of each window report as many ones as they do.

    A median of integers is up to half a one wrong. The mean number of ones is not, but outliers
    change it, so it needs a start and the jots to use.

    Parameters
    ----------
    flat : JotCounts
        The counts of even light.
    dark, start : ndarray of float64
        Dark counts per frame, and about the light of each jot.
    used : ndarray of bool
        The jots that are no outliers.
    filters : ndarray of int, optional
        The place of the color filter of each jot.
    """
    light, weight = start, used.astype(np.float64)
    lowest = 1e-3 * float(np.median(start[used]))
    for _ in range(_STEPS):
        excess, slope = excess_and_slope(flat, dark, light)
        passed = _passed(light, excess, slope, used, filters)
        # P is nearly linear in the light of a window, so this is a step of Newton's method.
        shown = light / passed
        total = window_sum(weight * slope / shown)
        known = total > _MIN_SLOPE
        shown[known] = window_sum(weight * (excess + slope))[known] / total[known]
        light = np.maximum(passed * shown, lowest)
    excess, slope = excess_and_slope(flat, dark, light)
    total = np.maximum(window_sum(weight * slope), _MIN_SLOPE)
    error = light * np.sqrt(np.maximum(window_sum(weight * excess**2), 0)) / total
    return LocalLight(light, light / passed, error, excess, slope, np.rint(window_sum(weight)))


def window_mean(values: Array, used: Mask) -> Array:
    """Return the mean over the used jots of the window around each jot, or 0 without any."""
    number = np.rint(window_sum(used.astype(np.float64)))
    return np.where(number > 0, window_sum(values * used) / np.maximum(number, 1), 0.0)


def excess_and_slope(flat: JotCounts, dark: Array, light: Array) -> tuple[Array, Array]:
    """Return the excess and the slope of each jot, as :class:`LocalLight` defines them."""
    rate = dark + light
    excess = flat.fractions - detection_probability(flat.threshold, rate)
    return excess, light * detection_density(flat.threshold, rate)


def _passed(
    light: Array, excess: Array, slope: Array, used: Mask, filters: Pattern | None
) -> Array:
    """Return the mean light behind the filter of each jot, (H, W); 1 for a gray sensor."""
    passed = np.ones(light.shape)
    for index in () if filters is None else np.unique(filters):
        own = (filters == index) & used
        change = excess[own].sum() / max(slope[own].sum(), _MIN_SLOPE)
        usual = np.median(light[own]) if own.any() else np.median(light)
        passed[filters == index] = usual * (1 + np.clip(change, -_MAX_STEP, _MAX_STEP))
    return passed


def window_sum(values: Array) -> Array:
    """Return the sum over the window around each jot, which ends at the edge of the sensor."""
    from scipy.ndimage import uniform_filter

    sides = _sides(values.shape)
    mean = interruptible(uniform_filter)(values, size=sides, mode="constant")
    return np.asarray(mean * (sides[0] * sides[1]))


def _sides(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the odd sides of a window on a sensor of this shape."""
    return tuple(min(WINDOW, size - 1 + size % 2) for size in shape)


def _light_behind(filters: Pattern | None, light: Array, bad: Mask) -> Array:
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


def _local_median(light: Array, bad: Mask) -> Array:
    """Return the median around each jot. The median of a first pass replaces bad jots."""
    from scipy.ndimage import median_filter

    first = np.where(bad, np.median(light[~bad]), light)
    median = interruptible(median_filter)
    first = median(first, size=_sides(light.shape), mode="reflect")
    values = np.where(bad, first, light)
    return np.asarray(median(values, size=_sides(light.shape), mode="reflect"))
