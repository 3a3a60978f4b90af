"""Jots whose response is no ordinary one: neither PRNU nor chance explains their counts."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.calibration.jot_counts import JotCounts
from jotlight.sensing.parameters.response import detection_probability

OUTLIER = 4.0
"""A response at least this many standard deviations from 1 is an outlier: it is not shrunk.

`docs/results/calibration.md` has the measurement behind this number.
"""

_NODES = np.linspace(-6, 6, 81)
"""Responses of ordinary jots, in standard deviations from 1, over which their counts are summed."""


def find_outliers(
    flat: JotCounts,
    dark: Array,
    light: Array,
    relative: Array,
    noise: Array,
    prnu: float,
    limit: float = OUTLIER,
) -> npt.NDArray[np.bool_]:
    """Return the jots whose response, and whose count, are too far from those of ordinary jots.

    Near saturation, the noise of a measured response is skew: ordinary jots with few zeros seem to
    respond strongly. So the count must be improbable, too. Its probability is binomial, and the
    response of ordinary jots is normal with mean 1 and standard deviation PRNU.

    Parameters
    ----------
    flat : JotCounts
        The counts of n jots with light.
    dark, light : ndarray of float64, shape (n,)
        Dark counts, and detected photons of a jot with response 1, per frame.
    relative, noise : ndarray of float64, shape (n,)
        The measured responses, and the variances of their noise to first order.
    prnu : float
        Standard deviation of the true response over ordinary jots.
    limit : float
        The number of standard deviations of a normal distribution whose tails are improbable.

    Examples
    --------
    >>> counts = JotCounts(np.array([7, 0], np.int32), 8, 1)  # of 8 frames
    >>> dark, light, noise = np.zeros(2), np.full(2, 0.4), np.full(2, 0.04)
    >>> find_outliers(counts, dark, light, counts.detections() / light, noise, 0.02)
    array([False, False])
    """
    from scipy.special import bdtr, bdtrc, ndtr

    found = (relative - 1) ** 2 > limit**2 * (prnu**2 + noise)
    responses = np.maximum(1 + prnu * _NODES[:, None], 0)
    weights = np.exp(-(_NODES**2) / 2)
    p = detection_probability(flat.threshold, dark[found] + light[found] * responses)
    ones = flat.ones[found].astype(np.float64)
    # P(L or more); 0 or more ones are certain.
    at_least = np.where(ones > 0, bdtrc(np.maximum(ones - 1, 0), flat.frames, p), 1.0)
    tails = np.minimum(weights @ at_least, weights @ bdtr(ones, flat.frames, p)) / weights.sum()
    found[found] = tails < ndtr(-limit)
    return found
