"""Flags: pixels of a merged image that are not to be trusted."""

import numpy as np
import numpy.typing as npt

from jotlight.blur import blur
from jotlight.motion.consistency import Consistent
from jotlight.motion.disagreement import Image
from jotlight.motion.tiles import add_squares

_MAX_DISAGREEMENT, _UNCLEAR_DISAGREEMENT = 1.3, 1.2
"""Pixels are flagged where frames before and after the reference time disagree more than this.

The second value is for unclear scenes.
"""

_MIN_ACCEPTED, _UNCLEAR_ACCEPTED = 0.85, 0.9
"""Pixels are flagged where less than this fraction of their bits was accepted.

The second value is for unclear scenes. In others, good bits of fine patterns may be rejected, too.
"""

_MARGIN = 3
"""Distance in pixels at which pixels near others with few accepted bits are flagged, too."""

_OUTLINE = 8
"""Distance in pixels at which pixels near an outline are flagged."""

_UNCLEAR_MARGIN, _UNCLEAR_GROWTH = 20, 10
"""Distances in unclear scenes: near pixels with few accepted bits, and near those that disagree."""

_SPREAD, _SQUARE = 8.0, 4
"""Standard deviation of the filter of rejected bits in pixels, and side of the squares over which
they are added before."""

_MAX_REJECTED, _CONCENTRATION = 0.22, 4.0
"""A scene is unclear where objects move by themselves: in 1 % of its pixels, more than this part
of the filtered bits is rejected, and this many times more than on average."""

_STRONG, _MAX_STRONG = 1.5, 0.01
"""A scene is unclear if more than this fraction of the pixels (second value) disagrees by more than
the first value."""

_IN_VIEW = 0.9
"""Whether a scene is unclear is decided where pixels have this fraction of the most trials.

Others leave the view at some times, so flicker changes their brightness by another factor.
"""


def is_unclear(
    consistent: Consistent, disagreements: Image, model: str, threads: int | None = None
) -> bool:
    """Return whether the model does not explain the scene well.

    This is so if each tile has its own motion. It is also so if there is one motion, but bits are
    rejected in some places, or the frames before and after the reference time disagree strongly.
    """
    if model in ("tiles", "segments"):
        return model == "tiles"
    trials = consistent.total.trials / np.maximum(consistent.accepted, np.float32(1e-3))
    in_view = trials >= _IN_VIEW * trials.max()
    pixels = add_squares(in_view, _SQUARE)
    lost = add_squares(in_view * (1 - consistent.accepted), _SQUARE)
    both = blur(np.stack([lost, pixels]) / _SQUARE**2, _SPREAD / _SQUARE, threads)
    rejected = (both[0] / np.maximum(both[1], np.float32(1e-3)))[pixels > 0]
    largest = float(np.quantile(rejected, 0.99))
    is_local = largest > max(_MAX_REJECTED, _CONCENTRATION * float(rejected.mean()))
    strong = np.count_nonzero(in_view & (disagreements > _STRONG))
    return is_local or bool(strong > _MAX_STRONG * np.count_nonzero(in_view))


def find_flags(
    consistent: Consistent,
    disagreements: Image,
    labels: npt.NDArray[np.uint8],
    *,
    is_unclear: bool = False,
) -> npt.NDArray[np.bool_]:
    """Return the pixels (H, W) that may have larger errors than their number of trials explains.

    They are near outlines, their bits were rejected, or the frames before and after the reference
    time disagree, which shows errors of the motion. In unclear scenes, more neighbors of such
    pixels are flagged.

    Parameters
    ----------
    consistent : Consistent
        The sums along the motion.
    disagreements : ndarray of float32, shape (H, W)
        The disagreement of the frames before the reference time with those after it.
    labels : ndarray of uint8, shape (H, W)
        The segments of the motion.
    is_unclear : bool
        What :func:`is_unclear` returns.
    """
    few = consistent.accepted < (_UNCLEAR_ACCEPTED if is_unclear else _MIN_ACCEPTED)
    # Dead jots have no bits, which says nothing about their neighbors.
    dead: npt.NDArray[np.bool_] = consistent.total.trials == 0
    outlines = np.zeros(labels.shape, bool)
    outlines[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    outlines[1:] |= labels[1:] != labels[:-1]
    limit = _UNCLEAR_DISAGREEMENT if is_unclear else _MAX_DISAGREEMENT
    return (
        _grow(disagreements > limit, _UNCLEAR_GROWTH if is_unclear else 0)
        | _grow(few & ~dead, _UNCLEAR_MARGIN if is_unclear else _MARGIN)
        | dead
        | _grow(outlines, _OUTLINE)
    )


def _grow(pixels: npt.NDArray[np.bool_], distance: int) -> npt.NDArray[np.bool_]:
    """Return the pixels whose square neighborhood contains one of some pixels."""
    if not pixels.any():
        return pixels
    grown = pixels.copy()
    for image in (grown, grown.T):
        before = image.copy(order="K")
        for shift in range(1, distance + 1):
            image[shift:] |= before[:-shift]
            image[:-shift] |= before[shift:]
    return grown
