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

_MAX_REJECTED = 0.02
"""Fraction of rejected bits above which a scene is unclear, unless it has segments."""

_UNCLEAR_MARGIN, _UNCLEAR_GROWTH = 16, 8
"""Distances in unclear scenes: near pixels with few accepted bits, and near those that disagree."""


def is_unclear(consistent: Consistent, model: str) -> bool:
    """Return whether the model does not explain the scene well.

    This is so if each tile has its own motion, or if many bits are rejected although only one
    motion is known.
    """
    rejected = 1 - float(consistent.accepted.mean())
    return model == "tiles" or (model != "segments" and rejected > _MAX_REJECTED)


def find_flags(
    consistent: Consistent, labels: npt.NDArray[np.uint8], *, is_unclear: bool = False
) -> npt.NDArray[np.bool_]:
    """Return the pixels (H, W) that may have larger errors than their number of trials explains.

    They are near outlines, their bits were rejected, or the frames before and after the reference
    time disagree, which shows errors of the motion. In unclear scenes, more neighbors of such
    pixels are flagged.
    """
    unsteady = disagreement(consistent.before, consistent.after) > _MAX_DISAGREEMENT
    few = consistent.accepted < _MIN_ACCEPTED
    outlines = np.zeros(labels.shape, bool)
    outlines[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    outlines[1:] |= labels[1:] != labels[:-1]
    return (
        _grow(unsteady, _UNCLEAR_GROWTH if is_unclear else 0)
        | _grow(few, _UNCLEAR_MARGIN if is_unclear else _MARGIN)
        | _grow(outlines, _OUTLINE)
    )


def _grow(pixels: npt.NDArray[np.bool_], distance: int) -> npt.NDArray[np.bool_]:
    """Return the pixels whose square neighborhood contains one of some pixels."""
    from scipy.ndimage import maximum_filter

    return np.asarray(maximum_filter(pixels, 2 * distance + 1))
