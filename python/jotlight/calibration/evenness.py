"""Tests of captures: whether a flat one has even light, and a dark one none."""

import math

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Mask
from jotlight.calibration.light import LocalLight, window_mean, window_sum
from jotlight.errors import PeriodicRatesWarning, warn
from jotlight.sensing.data.periodic_rates import THRESHOLD, PeriodicRates, largest_period
from jotlight.squares import mean_squares

MIN_STRUCTURE = 0.1
"""Minimum standard deviation of light that looks like the image of a scene, relative to the mean.

`docs/results/calibration.md` has the measurement behind this number.
"""

_DEGREE = 4
"""Degree of the polynomial that describes the smooth falloff of the light."""

_STEP = 3
"""Distance of the jots at which the light is compared. A window makes it smoother than that."""

_MIN_RATIO = 4.0
"""Minimum variance of the rest, in variances of the error of the light."""

_MAX_RELATIVE = 3.0
"""Limit of the light of a jot in a test of periods. Few stuck jots would determine the scatter."""


def warn_about_light(found: LocalLight, relative: Array, known: Mask, gray: bool) -> None:
    """Warn about the rates of a mosaic that is not stated, or else about the image of a scene.

    Parameters
    ----------
    found : LocalLight
        The light on each jot.
    relative : ndarray of float64
        The light that each jot measured, divided by the light on it.
    known : ndarray of bool
        The jots that are not hot.
    gray : bool
        Whether no mosaic is stated.
    """
    periodic = find_periods(relative, known) if gray else None
    if periodic is not None:
        warn(periodic.describe_flat(), PeriodicRatesWarning)
        return
    structure = light_structure(found.shown, found.error * found.shown / found.light)
    if structure > MIN_STRUCTURE:
        warn(
            f"flat: expected even light, got differences of {structure:.0%} that no slow change "
            "explains, as in the image of a scene; the response may contain the scene. Record a "
            "white wall out of focus, or an integrating sphere"
        )


def warn_about_scene(rates: Array, hot: Mask) -> None:
    """Warn if a dark capture shows the image of a scene.

    Parameters
    ----------
    rates : ndarray of float64, shape (H, W)
        The fraction of ones of each jot.
    hot : ndarray of bool, shape (H, W)
        The hot jots, which are not compared.
    """
    mean = window_mean(rates, ~hot)
    variance = np.maximum(window_mean(rates**2, ~hot) - mean**2, 0)
    error = np.sqrt(variance / np.maximum(window_sum((~hot).astype(np.float64)), 1))
    structure = light_structure(mean, error)
    if structure > MIN_STRUCTURE:
        warn(
            f"dark: expected a capture without light, got differences of {structure:.0%} between "
            "groups of jots that no slow change explains, as in the image of a scene, or where a "
            "part of the sensor is dead or glows; if light reached the sensor, cover it, and "
            "record again"
        )


def light_structure(light: Array, error: Array) -> float:
    """Return the standard deviation of the light from a polynomial, relative to its mean.

    Optics and lamps make the light fall off smoothly, which a polynomial of degree 4 of the place
    describes. The image of a scene remains. A sensor of less than about 60 x 60 jots has too few
    windows beside each other to tell them apart, and the polynomial describes both.

    Parameters
    ----------
    light, error : ndarray of float64, shape (H, W)
        The light on each jot, and its standard error. The variance of the error is subtracted, and
        the result is 0 unless the rest is significant.

    Examples
    --------
    >>> y, x = np.mgrid[-1:1:120j, -1:1:160j]
    >>> falloff = (1 + (x**2 + y**2) / 4) ** -2  # the fourth power of a cosine
    >>> light_structure(falloff, 0 * falloff) < 0.01
    True
    >>> round(light_structure(falloff * np.where(x + y > 0.2, 1, 0.5), 0 * falloff), 1)
    0.2
    """
    columns, rows = (np.linspace(-1, 1, len(range(0, n, _STEP))) for n in light.shape[::-1])
    y, x = (each.ravel() for each in np.meshgrid(rows, columns, indexing="ij"))
    terms = [x**a * y**b for a in range(_DEGREE + 1) for b in range(_DEGREE + 1 - a)]
    design = np.stack(terms, axis=1)
    values = light[::_STEP, ::_STEP].ravel()
    rest = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    scatter, noise = float((rest**2).mean()), float((error**2).mean())
    if scatter < _MIN_RATIO * noise:
        return 0.0
    return math.sqrt(scatter - noise) / max(float(values.mean()), 1e-300)


def find_periods(relative: Array, known: Mask) -> PeriodicRates | None:
    """Return the period with which the rates of a flat capture repeat, or None.

    Even light has no texture, so a few rows of jots suffice. Where
    :func:`jotlight.calibration.find_periodic_rates` compares tiles of a scene, this test compares
    the means of even and odd rows, those of even and odd columns, and the checkerboards of single
    cells. The scatter of the compared means includes the response, and rows and columns that differ
    without a period.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> jots = 1 + 0.1 * rng.standard_normal((16, 16))
    >>> find_periods(jots, np.ones((16, 16), bool)) is None
    True
    >>> colors = jots * np.tile([[1.5, 1.0], [1.0, 0.7]], (8, 8))
    >>> find_periods(colors, np.ones((16, 16), bool)).greens
    'as in RGGB or BGGR'
    """
    rates = np.where(known, np.clip(relative, 0, _MAX_RELATIVE), 1.0).astype(np.float32)
    return largest_period(rates, _score)


def _binned(rates: npt.NDArray[np.float32], side: int) -> Array:
    """Return the means of squares of jots, with an even number of rows and columns of them."""
    height, width = (length // (2 * side) * 2 for length in rates.shape)
    return mean_squares(rates[: height * side, : width * side], side, np.float64)


def _score(jots: npt.NDArray[np.float32], side: int) -> tuple[float, float]:
    """Return how much alternating parts exceed their error, in σ, and their amplitude.

    `side` is half of the period.
    """
    rates = _binned(jots, side)
    if min(rates.shape) < 4:
        return 0.0, 0.0
    cells = rates.reshape(rates.shape[0] // 2, 2, rates.shape[1] // 2, 2)
    board = (cells[:, 0, :, 0] + cells[:, 1, :, 1] - cells[:, 0, :, 1] - cells[:, 1, :, 0]) / 4
    scores = [_normal_score(float(board.mean()), board.ravel())]
    parts = [float(board.mean())]
    for means in (rates.mean(0), rates.mean(1)):
        even, odd = means[::2], means[1::2]
        half = float(even.mean() - odd.mean()) / 2
        parts.append(half)
        scores.append(_normal_score(half, np.concatenate([even - even.mean(), odd - odd.mean()])))
    # The amplitude does not contain what the scatter explains.
    power = sum(part**2 for part, score in zip(parts, scores, strict=True) if score > THRESHOLD)
    return max(scores), math.sqrt(power) / max(float(rates.mean()), 1e-9)


def _normal_score(mean: float, values: Array) -> float:
    """Return the score of a normal variable that is as unlikely as this mean.

    The mean follows Student's t distribution. Wallace's formula is close far out in its tails.
    """
    freedom = values.size - 2
    error = float(values.std()) / math.sqrt(max(freedom, 1))
    if freedom < 1 or mean == 0:
        return 0.0
    t_squared = (mean / max(error, 1e-9)) ** 2
    factor = (8 * freedom + 1) / (8 * freedom + 3)
    return factor * math.sqrt(freedom * math.log1p(t_squared / freedom))
