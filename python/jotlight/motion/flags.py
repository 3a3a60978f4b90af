"""Flags: pixels of a merged image that are not to be trusted."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.consistency import Consistent, disagreement

_MAX_DISAGREEMENT = 1.2
"""Pixels are flagged where frames before and after the reference time disagree more than this."""

_MIN_ACCEPTED = 0.9
"""Pixels are flagged where less than this fraction of their bits was accepted."""

_MARGIN = 4
"""Distance in pixels at which pixels near others with few accepted bits are flagged, too."""

_OUTLINE = 8
"""Distance in pixels at which pixels near an outline are flagged."""


def find_flags(consistent: Consistent, labels: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
    """Return the pixels (H, W) that may have larger errors than their number of trials explains.

    They are near outlines, their bits were rejected, or the frames before and after the reference
    time disagree, which shows errors of the motion.
    """
    unsteady = disagreement(consistent.before, consistent.after) > _MAX_DISAGREEMENT
    rejected = consistent.accepted < _MIN_ACCEPTED
    outlines = np.zeros(labels.shape, bool)
    outlines[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    outlines[1:] |= labels[1:] != labels[:-1]
    return unsteady | _grow(rejected, _MARGIN) | _grow(outlines, _OUTLINE)


def _grow(pixels: npt.NDArray[np.bool_], distance: int) -> npt.NDArray[np.bool_]:
    """Return the pixels whose square neighborhood contains one of some pixels."""
    from scipy.ndimage import maximum_filter

    return np.asarray(maximum_filter(pixels, 2 * distance + 1))
