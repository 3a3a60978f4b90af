"""Flags: pixels of a merged image that are not to be trusted."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.blur import blur
from jotlight.motion.consistency import Consistent
from jotlight.motion.disagreement import Image
from jotlight.motion.expected_errors import (
    is_dim,
    is_displaced,
    largest_nearby,
    may_hide_displacements,
    steep_pixels,
)
from jotlight.motion.motion import Motion
from jotlight.motion.scoring import make_template
from jotlight.motion.tiles import add_squares

Mask = npt.NDArray[np.bool_]


class _Limits(NamedTuple):
    """Where pixels are flagged."""

    disagreement: float
    """Where frames before and after the reference time disagree more than this."""
    accepted: float
    """Where less than this fraction of their bits was accepted."""
    near_disagreement: int
    """And at this distance in pixels from the former."""
    near_few: int
    """And at this distance from the latter."""
    near_outline: int
    """And at this distance from an outline."""


_LIMITS, _UNCLEAR = _Limits(1.3, 0.85, 0, 3, 8), _Limits(1.2, 0.9, 10, 20, 8)
"""Limits of the flags that the bits show, for clear and for unclear scenes.

In clear scenes, good bits of fine patterns may be rejected, too.
"""

_UNCLEAR_IMAGE = _UNCLEAR._replace(near_disagreement=3, near_few=5)
"""Limits of the flags of images of unclear scenes, which mark steep pixels besides."""

_NEAR_OUTLINE, _ONES, _EXPONENT = 16, 12.0, 1 / 3
"""Distance from outlines for flags of images with a mean number of ones per pixel (second value).

The distance to the power of -3 is proportional to the number of ones, because the bits of a wider
region show whether it is inside.
"""

_OUTLINE_LIMITS = 8, 24
"""Limits of this distance."""

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
    return _beyond(_UNCLEAR if is_unclear else _LIMITS, consistent, disagreements, labels)


def flags_of_image(
    consistent: Consistent,
    disagreements: Image,
    motion: Motion,
    threads: int | None = None,
    *,
    is_unclear: bool,
) -> Mask:
    """Return the pixels (H, W) of an image where larger errors are expected, or shown by the bits.

    If each tile has its own motion, and if a dim scene moves that is unclear or whose tiles
    together show that frames are displaced, steep pixels are flagged. Outlines may be displaced,
    too: the less light there is, the farther.

    Parameters
    ----------
    consistent, disagreements, is_unclear
        As for :func:`find_flags`.
    motion : Motion
        The motion.
    threads : int, optional
        Number of threads.
    """
    ones = max(float(consistent.total.ones.mean()), 1e-9)
    distance = round(_NEAR_OUTLINE * (_ONES / ones) ** _EXPONENT)
    near_outline = int(np.clip(distance, *_OUTLINE_LIMITS))
    limits, steep = _LIMITS, np.zeros(motion.size, bool)
    if motion.model == "none" or (motion.model != "tiles" and not is_dim(consistent)):
        limits = _UNCLEAR if is_unclear else _LIMITS
    elif is_unclear or (motion.model == "affine" and may_hide_displacements(consistent)):
        template = make_template(consistent.total, threads)
        if is_unclear or is_displaced(consistent, template):
            limits, steep = _UNCLEAR_IMAGE, steep_pixels(template)
    limits = limits._replace(near_outline=near_outline)
    return steep | _beyond(limits, consistent, disagreements, motion.labels)


def _beyond(
    limits: _Limits,
    consistent: Consistent,
    disagreements: Image,
    labels: npt.NDArray[np.uint8],
) -> Mask:
    """Return the pixels beyond limits, and those near them, and pixels without bits."""
    disagrees: Mask = disagreements > limits.disagreement
    few: Mask = consistent.accepted < limits.accepted
    # Dead jots have no bits, which says nothing about their neighbors.
    dead: Mask = consistent.total.trials == 0
    outlines = np.zeros(labels.shape, bool)
    outlines[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    outlines[1:] |= labels[1:] != labels[:-1]
    near: Mask = largest_nearby(disagrees, limits.near_disagreement)
    near |= largest_nearby(few & ~dead, limits.near_few)
    near |= largest_nearby(outlines, limits.near_outline)
    return near | dead
