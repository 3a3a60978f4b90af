"""Dead jots: those whose response differs too much from that of their neighborhood."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.calibration.jot_counts import JotCounts
from jotlight.calibration.light import LocalLight
from jotlight.sensing.parameters.binomial import clopper_pearson
from jotlight.sensing.parameters.response import (
    detection_probability,
    inverse_detection_probability,
)

MIN_RESPONSE = 0.2
"""Minimum response of a working jot relative to its neighborhood. The maximum is its inverse."""


def find_dead_jots(
    flat: JotCounts, dark: JotCounts, found: LocalLight, false_positive_rate: float
) -> npt.NDArray[np.bool_]:
    """Return the jots that respond too weakly or too strongly to the light around them.

    A jot is dead if no dark counts and no light within their confidence limits explain its count.

    Parameters
    ----------
    flat, dark : JotCounts
        The counts with light, and without.
    found : LocalLight
        The light on each jot.
    false_positive_rate : float
        Maximum probability that a jot with 1/5 to 5 times the response of its neighborhood is
        called dead.

    Notes
    -----
    Three things may differ from their expected values by chance: the dark capture, the light, and
    the flat capture, each in two directions. Each of the six may do so with a sixth of the
    false-positive rate, so the sum of all is at most the rate, whatever the dark counts of the jot
    are. The limits of the dark counts are those of Clopper and Pearson. They and the binomial tail
    of the count are exact. The error of the light is normal, as it is a mean over many jots.
    """
    from scipy.special import bdtr, bdtrc
    from scipy.stats import norm

    share = false_positive_rate / 6
    low, high = _dark_limits(dark, share)
    margin = norm.isf(share) * found.error
    ones, frames, threshold = flat.ones, flat.frames, flat.threshold
    darkest, brightest = np.maximum(found.light - margin, 0), found.light + margin
    weak = detection_probability(threshold, low + MIN_RESPONSE * darkest)
    strong = detection_probability(threshold, high + brightest / MIN_RESPONSE)
    # The probability of 0 ones or more is 1, for which bdtrc(-1) is not defined.
    many = np.where(ones > 0, bdtrc(np.maximum(ones - 1.0, 0), frames, strong), 1.0)
    return np.asarray((bdtr(ones * 1.0, frames, weak) <= share) | (many <= share))


def _dark_limits(dark: JotCounts, share: float) -> tuple[Array, Array]:
    """Return limits of the dark counts that are wrong with at most this probability each.

    Examples
    --------
    >>> low, high = _dark_limits(JotCounts(np.array([[0, 10]], np.int32), 10, 1), 0.05)
    >>> low.round(3).tolist(), high.round(3).tolist()  # 0.3 = -ln(0.05) / 10
    ([[0.0, 1.351]], [[0.3, inf]])
    """
    unique, index = np.unique(dark.ones, return_inverse=True)
    frames = np.asarray(float(dark.frames))
    interval = clopper_pearson(unique.astype(np.float64), frames, share, jots_differ=False)
    low, high = (
        inverse_detection_probability(dark.threshold, p, rest)[index].reshape(dark.ones.shape)
        for p, rest in interval
    )
    return low, high
