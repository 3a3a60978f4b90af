"""Tests whether hot jots have the dark counts of a dark capture in another capture, too."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.calibration.jot_counts import JotCounts
from jotlight.errors import warn
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import frames_within
from jotlight.sensing.parameters.response import detection_probability
from jotlight.sensing.sensor import Sensor

MIN_DARK = 0.1
"""Minimum dark counts per frame of a jot that a scene reveals."""

_MIN_RATIO = 4.0
"""Minimum dark counts of such a jot, in those of the median jot."""

_MAX_BYTES = 1 << 26
"""Maximum number of bytes of bits that are compared."""

_REACH = 2
"""The light on a jot is that of the jots at most this many rows and columns away."""

_MIN_SCORE = 4.75
"""Score above which a scene contradicts dark counts. Chance exceeds it with a probability of 1e-6.
"""

_BORDER = 0.5
"""Fraction of the dark counts. A jot contradicts them if it detects less than that and the light.

A jot that has the dark counts detects all of them, and a jot that has none detects the light alone.
"""


def warn_about_different_captures(
    flat: JotCounts,
    dark: Array,
    light: Array,
    hot: npt.NDArray[np.bool_],
    false_positive_rate: float,
) -> None:
    """Warn if most hot jots of the dark capture have no such dark counts in the flat capture.

    Parameters
    ----------
    flat : JotCounts
        The counts of the flat capture.
    dark, light : ndarray of float64
        The dark counts of each jot, and the light on it, from the jots around it.
    hot : ndarray of bool
        The hot jots to compare.
    false_positive_rate : float
        Maximum probability of a warning if the two captures fit together.
    """
    missing, number, score = missing_dark_counts(flat, dark, light, hot)
    from scipy.stats import norm

    if score > norm.isf(false_positive_rate):
        warn(
            f"flat: {missing:,} of {number:,} hot jots do not have the dark counts of the dark "
            "capture, so the two captures do not fit together and the calibration may be wrong; "
            "check the numbers of frames (--frames, --flat-frames), and record both captures with "
            "the same sensor, orientation, exposure time, and temperature"
        )


def missing_dark_counts(
    jots: JotCounts, dark: Array, light: Array, hot: npt.NDArray[np.bool_]
) -> tuple[int, int, float]:
    """Return how many hot jots lack their dark counts, of how many, and the score of this number.

    The score is in standard deviations. It compares the number with the largest one that chance
    explains: half of the jots, or more where few frames make it more likely.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> dark, light, hot = np.full((5, 8), 0.5), np.full((5, 8), 0.7), np.ones((5, 8), bool)
    >>> ones = rng.binomial(1000, -np.expm1(-(dark + light)))
    >>> missing_dark_counts(JotCounts(ones, 1000, 1), dark, light, hot)[:2]
    (0, 40)
    >>> ones = rng.binomial(1000, -np.expm1(-light))
    >>> missing_dark_counts(JotCounts(ones, 1000, 1), dark, light, hot)[:2]
    (40, 40)
    """
    from scipy.stats import binom

    dark, light, counts, frames = dark[hot], light[hot], jots.ones[hot], jots.frames
    if not counts.size:
        return 0, 0, 0.0
    border = frames * detection_probability(jots.threshold, light + _BORDER * dark)
    # A jot without zeros may have any dark counts.
    lacking = (counts < border) & (counts < frames)
    chance = binom.cdf(
        np.minimum(np.ceil(border), frames) - 1,
        frames,
        detection_probability(jots.threshold, light + dark),
    )
    chance = np.maximum(chance, 0.5)
    spread = max(float(np.sqrt((chance * (1 - chance)).sum())), 1e-9)
    return int(lacking.sum()), counts.size, float((lacking.sum() - chance.sum()) / spread)


def dark_count_conflict(jots: JotCounts, dark: npt.ArrayLike) -> tuple[int, int] | None:
    """Return how many hot jots lack their dark counts in a scene, and of how many, or None.

    The result is None unless more than half of the jots lack them, and chance does not explain it.

    Parameters
    ----------
    jots : JotCounts
        The counts of the scene.
    dark : array_like of float
        Dark counts per frame, a number or a map.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> dark = np.where(rng.random((64, 64)) < 0.02, 1.0, 0.001)
    >>> own = rng.binomial(16, -np.expm1(-dark - 0.2))
    >>> dark_count_conflict(JotCounts(own, 16, 1), dark) is None
    True
    >>> dark_count_conflict(JotCounts(own[::-1], 16, 1), dark)
    (86, 88)
    """
    rates = np.asarray(dark, np.float64)
    if rates.shape != jots.ones.shape:
        return None
    hot = rates > max(MIN_DARK, _MIN_RATIO * float(np.median(rates)))
    if not hot.any() or hot.all():
        return None
    light = np.zeros(rates.shape)
    light[hot] = _light_of_neighbors(jots.detections() - rates, hot)
    missing, number, score = missing_dark_counts(jots, rates, light, hot)
    return (missing, number) if score > _MIN_SCORE else None


def describe_conflict(jots: JotCounts, dark: npt.ArrayLike) -> str | None:
    """Return that most hot jots are not hot in a scene, and what to do, or None if it is not so.

    Parameters
    ----------
    jots : JotCounts
        The counts of the scene.
    dark : array_like of float
        Dark counts per frame, a number or a map.
    """
    found = dark_count_conflict(jots, dark)
    if found is None:
        return None
    missing, number = found
    return (
        f"{missing:,} of the {number:,} jots with many dark counts do not show them in this "
        "capture, so the dark counts are wrong; calibrate with captures of the same sensor, "
        "orientation, exposure time, and temperature"
    )


def warn_about_conflict(bits: Bits, sensor: Sensor) -> None:
    """Warn if most hot jots of a sensor are not hot in the first frames of bits.

    Bits whose jots have different thresholds, gains, filters, or channels are not compared.
    """
    if sensor.readings_differ or sensor.mosaic is not None or len(bits.shape) > 3:
        return
    first = bits[: frames_within(bits.packed, _MAX_BYTES)]
    jots = JotCounts(first.counts(1), len(first), int(sensor.threshold))
    conflict = describe_conflict(jots, sensor.dark_counts)
    if conflict is not None:
        warn(f"calibration: {conflict}")


def _light_of_neighbors(light: Array, hot: npt.NDArray[np.bool_]) -> Array:
    """Return the light around each hot jot, (N,): the median or the mean, whichever is lower.

    The median of few counts may be too high by half a count. The mean is too high near bright
    points. Light that is too low makes no jot lack dark counts.
    """
    height, width = light.shape
    rows, columns = np.nonzero(hot)
    steps = np.arange(-_REACH, _REACH + 1)
    down, right = (each.ravel() for each in np.meshgrid(steps, steps, indexing="ij"))
    near_rows = rows[:, None] + down
    near_columns = columns[:, None] + right
    inside = (near_rows >= 0) & (near_rows < height) & (near_columns >= 0) & (near_columns < width)
    place = np.clip(near_rows, 0, height - 1), np.clip(near_columns, 0, width - 1)
    usable = inside & ~hot[place]
    values = np.ma.masked_array(light[place], ~usable)
    lower = np.minimum(np.ma.median(values, axis=1).filled(0), values.mean(axis=1).filled(0))
    return np.asarray(np.maximum(lower, 0), np.float64)
