"""The planes that a film network reads: an estimate, counts of parts of a window, the last image.

The gray network estimates each image of a film from the counts of a whole window. A film network
improves this estimate with what it does not know: the quarter of the window that is nearest to the
time of the image, the nearest sixteenth and its four neighbors, and the last image of the film.
Long counts have little noise, but show what has changed since; bits that disagree with the rest are
missing. Short counts show one moment with much noise, and neighboring moments show what has moved.
The last image, displaced along the motion, has little noise, but repeats what was wrong in it. For
each pixel, the planes state

- by how much z = arcsin √(L/K) of the counts of the window, of the quarter, and of the sixteenth
  deviates from z of the estimate, in three planes, and the root of their numbers of readings,
  relative to the usual one of the window, in three planes. A pixel without readings has zeros;
- by how much z of the last image deviates from the estimate, and whether the pixel lies inside it;
- z of the estimate;
- by how much z of each neighbor of the sixteenth deviates from the estimate, in four planes, and
  the root of their mean number of readings, relative to the usual one, in one plane.

The noise of z has the standard deviation 1/(2 √K) at every exposure.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jotlight.array_types import Image
from jotlight.networks.planes.planes_layers import CENTER
from jotlight.sensing.parameters.binomial import arcsin_root

NEIGHBORS = 4
"""Number of the sixteenths of a window that are next to the nearest one in time."""

PLANES = 9 + NEIGHBORS + 1
"""Number of planes."""

START = 8
"""Index of the plane of the estimate, at which the network starts."""

_DEVIATIONS = 0, 2, 4, *range(START + 1, PLANES - 1)
"""Planes of the deviations: of the window, the quarter, the sixteenth, and its neighbors."""

_READINGS = 1, 3, 5, PLANES - 1
"""Planes of the readings: of the window, the quarter, the sixteenth, and the mean neighbor."""

_MAX_SHARE = 1.5
"""The largest root of a number of readings, relative to the usual one. The engine's check
against overflow assumes planes from −π/2 to π/2, so larger values are cut."""


class Counts(NamedTuple):
    """Counts of a part of a window."""

    fraction: Image
    """L/K, (H, W)."""
    trials: Image
    """The number of readings behind each pixel, (H, W)."""


def usual_trials(window: Counts) -> float:
    """Return the median of the readings behind the pixels that have any; 1 if none has."""
    known = window.trials[window.trials > 0]
    return float(np.median(known)) if len(known) else 1.0


def film_planes(start: Image, counts: Sequence[Counts], usual: float, last: Image | None) -> Image:
    """Return the planes of an image, (14, H, W).

    Parameters
    ----------
    start : ndarray of float32, shape (H, W)
        P(b = 1) of the estimate.
    counts : sequence of Counts
        Those of the window, of a quarter of it, of a sixteenth, and of the neighbors of this
        sixteenth, in the order of their distance in time.
    usual : float
        The usual number of readings of the window: :func:`usual_trials`.
    last : ndarray of float32, shape (H, W), optional
        z of the last image, as the present one would show its points; NaN where it did not show
        them. Default: there is none.

    Examples
    --------
    >>> fraction, trials = np.full((2, 4, 6), 0.5, np.float32), np.full((2, 4, 6), 16.0, np.float32)
    >>> same = Counts(fraction[0], trials[0])
    >>> film_planes(fraction[1], [same] * 7, 16.0, None)[1:8:2, 0, 0].tolist()
    [1.0, 1.0, 1.0, 0.0]
    """
    estimate = arcsin_root(start)
    planes = np.zeros((PLANES, *start.shape), np.float32)
    for index, (fraction, trials) in zip(_DEVIATIONS, counts, strict=True):
        planes[index] = np.where(trials > 0, arcsin_root(fraction) - estimate, 0)
    readings = [each.trials for each in counts]
    mean_neighbor = np.mean(readings[-NEIGHBORS:], axis=0)
    for index, each in zip(_READINGS, [*readings[:-NEIGHBORS], mean_neighbor], strict=True):
        planes[index] = np.minimum(np.sqrt(each / np.float32(usual)), np.float32(_MAX_SHARE))
    if last is not None:
        shown = np.isfinite(last)
        planes[6] = np.where(shown, last - estimate, 0)
        planes[7] = shown
    planes[START] = estimate - np.float32(CENTER)
    return planes
