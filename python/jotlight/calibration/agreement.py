"""The test whether the jots of a dark capture are those of another capture."""

import numpy as np
import numpy.typing as npt

from jotlight.calibration.rates import Rates
from jotlight.checks import Counts
from jotlight.errors import warn
from jotlight.sensing.response import detection_probability

_BORDER = 0.5
"""Fraction of the dark counts. A jot contradicts them if it detects less than that and the light.

A jot that has the dark counts detects all of them, and a jot that has none detects the light alone.
"""


def warn_about_dark_counts(
    ones: Counts,
    frames: int,
    dark: Rates,
    light: Rates,
    hot: npt.NDArray[np.bool_],
    threshold: int,
    false_positive_rate: float,
) -> None:
    """Warn if most hot jots of the dark capture have no such dark counts in the flat capture.

    Parameters
    ----------
    ones, frames : ndarray of int, int
        L of each jot in the flat capture, and the number of its frames.
    dark, light : ndarray of float64
        The dark counts of each jot, and the light on it, from the jots around it.
    hot : ndarray of bool
        The hot jots to compare.
    threshold : int
        q.
    false_positive_rate : float
        Maximum probability of a warning if the two captures fit together.
    """
    missing, number, score = missing_dark_counts(ones, frames, dark, light, hot, threshold)
    from scipy.stats import norm

    if score > norm.isf(false_positive_rate):
        warn(
            f"flat: {missing:,} of {number:,} hot jots do not have the dark counts of the dark "
            "capture, so the two captures do not fit together and the calibration may be wrong; "
            "check the numbers of frames (--frames, --flat-frames), and record both captures with "
            "the same sensor, orientation, exposure time, and temperature"
        )


def missing_dark_counts(
    ones: Counts,
    frames: int,
    dark: Rates,
    light: Rates,
    hot: npt.NDArray[np.bool_],
    threshold: int,
) -> tuple[int, int, float]:
    """Return how many hot jots lack their dark counts, of how many, and the score of this number.

    The score is in standard deviations. It compares the number with the largest one that chance
    explains: half of the jots, or more where few frames make it more likely.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> dark, light, hot = np.full((5, 8), 0.5), np.full((5, 8), 0.7), np.ones((5, 8), bool)
    >>> ones = rng.binomial(1000, -np.expm1(-(dark + light)))
    >>> missing_dark_counts(ones, 1000, dark, light, hot, 1)[:2]
    (0, 40)
    >>> ones = rng.binomial(1000, -np.expm1(-light))
    >>> missing_dark_counts(ones, 1000, dark, light, hot, 1)[:2]
    (40, 40)
    """
    from scipy.stats import binom

    dark, light, counts = dark[hot], light[hot], ones[hot]
    if not counts.size:
        return 0, 0, 0.0
    border = frames * detection_probability(threshold, light + _BORDER * dark)
    # A jot without zeros may have any dark counts.
    lacking = (counts < border) & (counts < frames)
    chance = binom.cdf(
        np.minimum(np.ceil(border), frames) - 1,
        frames,
        detection_probability(threshold, light + dark),
    )
    chance = np.maximum(chance, 0.5)
    spread = max(float(np.sqrt((chance * (1 - chance)).sum())), 1e-9)
    return int(lacking.sum()), counts.size, float((lacking.sum() - chance.sum()) / spread)
