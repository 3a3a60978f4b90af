"""The planes that a film network reads: counts of three lengths, and the last image of the film.

Each image of a film has counts of a whole window, of the quarter of it that is nearest to the time
of the image, and of the nearest sixteenth. Long counts have little noise, but show what has changed
since; bits that disagree with the rest are missing. Short counts show the present with much noise.
The last image of the film, displaced along the motion, has little noise, but repeats what was wrong
in it. So the network reads all of them:

- z = arcsin √(L/K) of the window, and this smoothed, which is where the network starts;
- by how much z of the shorter counts and of the last image deviates from it;
- the root of the number of readings behind each, relative to the usual number of the window, and
  whether the last image shows the pixel. A pixel without readings has zeros.

The noise of z has the standard deviation 1/(2 √K) at every exposure.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.estimators.trial_levels import fill_from_nearest

Image = npt.NDArray[np.float32]

PLANES = 9
"""Number of planes."""

LENGTHS = 3
"""Number of counts of different lengths."""

START = 8
"""Index of the plane at which the network starts."""

CENTER = np.pi / 4
"""The middle of the range of z, which is subtracted from it."""

_MAX_SHARE = 2.0
"""The largest root of a number of readings, relative to the usual one."""

_SMOOTH = 0.8
"""Standard deviation of the filter that smooths the start, in pixels."""


class Counts(NamedTuple):
    """Counts of one length."""

    fraction: Image
    """L/K, (H, W)."""
    trials: Image
    """The number of readings behind each pixel, (H, W)."""


def usual_trials(window: Counts) -> float:
    """Return the median of the readings behind the pixels that have any; 1 if none has."""
    known = window.trials[window.trials > 0]
    return float(np.median(known)) if len(known) else 1.0


def film_planes(counts: Sequence[Counts], usual: float, last: Image | None) -> Image:
    """Return the planes of an image, (9, H, W).

    Parameters
    ----------
    counts : sequence of Counts
        Those of the window, of a quarter of it, and of a sixteenth.
    usual : float
        The usual number of readings of the window: :func:`usual_trials`.
    last : ndarray of float32, shape (H, W), optional
        z of the last image, as the present one would show its points; NaN where it did not show
        them. Default: there is none.

    Examples
    --------
    >>> fraction, trials = np.full((2, 4, 6), 0.5, np.float32), np.full((2, 4, 6), 16.0, np.float32)
    >>> same = Counts(fraction[0], trials[0])
    >>> film_planes([same] * 3, 16.0, None)[:, 0, 0].tolist()
    [0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    """
    window = counts[0]
    known = window.trials > 0
    fraction = fill_from_nearest(window.fraction, known) if known.any() else window.fraction
    present = _arcsin_root(fraction)
    planes = np.zeros((PLANES, *present.shape), np.float32)
    planes[0] = present - np.float32(CENTER)
    for index, each in enumerate(counts):
        share = np.minimum(np.sqrt(each.trials / np.float32(usual)), np.float32(_MAX_SHARE))
        planes[2 * index + 1] = share
        if index:
            deviation = _arcsin_root(each.fraction) - present
            planes[2 * index] = np.where(each.trials > 0, deviation, 0)
    if last is not None:
        shown = np.isfinite(last)
        planes[6] = np.where(shown, last - present, 0)
        planes[7] = shown
    planes[START] = _smooth(planes[0])
    return planes


def _smooth(values: Image) -> Image:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, _SMOOTH, mode="mirror", truncate=4.0))


def _arcsin_root(fraction: Image) -> Image:
    return np.asarray(np.arcsin(np.sqrt(np.clip(fraction, 0, 1))), np.float32)
