"""Flags: pixels of a merged image that are not to be trusted."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image, Mask
from jotlight.blur import blur
from jotlight.motion.agreement.consistency import Consistent
from jotlight.motion.agreement.expected_errors import (
    is_dim,
    is_displaced,
    largest_nearby,
    may_hide_displacements,
    steep_pixels,
)
from jotlight.motion.displacements.scoring import make_template
from jotlight.motion.motion import Motion
from jotlight.motion.tiles import add_squares
from jotlight.squares import repeat_squares


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

_NEAR_UNCLEAR = 32
"""Distance in pixels from such places up to which the scene is unclear."""

_IN_VIEW = 0.9
"""Whether a scene is unclear is decided where pixels have this fraction of the most trials.

Others leave the view at some times, so flicker changes their brightness by another factor.
"""


def unclear_pixels(
    consistent: Consistent, disagreements: Image, model: str, threads: int | None = None
) -> Mask:
    """Return the pixels (H, W) where the model does not explain the scene well.

    These are all pixels if each tile has its own motion. If there is one motion, or none, they are
    those near places where bits are rejected, or where the frames before and after the reference
    time disagree strongly.
    """
    height, width = disagreements.shape
    if model in ("tiles", "segments"):
        return np.full((height, width), model == "tiles")
    trials = consistent.total.trials / np.maximum(consistent.accepted, np.float32(1e-3))
    in_view = trials >= _IN_VIEW * trials.max()
    pixels = add_squares(in_view, _SQUARE)
    lost = add_squares(in_view * (1 - consistent.accepted), _SQUARE)
    both = blur(np.stack([lost, pixels]) / _SQUARE**2, _SPREAD / _SQUARE, threads)
    rejected = np.where(pixels > 0, both[0] / np.maximum(both[1], np.float32(1e-3)), 0)
    in_squares = rejected[pixels > 0]
    unclear = np.zeros((height, width), bool)
    limit = max(_MAX_REJECTED, _CONCENTRATION * float(in_squares.mean()))
    if np.quantile(in_squares, 0.99) > limit:
        unclear |= repeat_squares(rejected > limit, _SQUARE, (height, width))
    strong = in_view & (disagreements > _STRONG)
    if np.count_nonzero(strong) > _MAX_STRONG * np.count_nonzero(in_view):
        unclear |= strong
    return largest_nearby(unclear, _NEAR_UNCLEAR)


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
        Whether the scene is unclear, at least in some places.
    """
    return _beyond(_UNCLEAR if is_unclear else _LIMITS, consistent, disagreements, labels)


def flags_of_image(
    consistent: Consistent,
    disagreements: Image,
    motion: Motion,
    threads: int | None = None,
    *,
    unclear: Mask,
) -> Mask:
    """Return the pixels (H, W) of an image where larger errors are expected, or shown by the bits.

    If each tile has its own motion, and where a dim scene moves that is unclear, steep pixels are
    flagged. If its tiles together show that frames are displaced, it is unclear everywhere.
    Outlines may be displaced, too: the less light there is, the farther.

    Parameters
    ----------
    consistent, disagreements
        As for :func:`find_flags`.
    motion : Motion
        The motion.
    threads : int, optional
        The number of threads.
    unclear : ndarray of bool, shape (H, W)
        What :func:`unclear_pixels` returns.
    """
    ones = max(float(consistent.total.ones.mean()), 1e-9)
    distance = round(_NEAR_OUTLINE * (_ONES / ones) ** _EXPONENT)
    near_outline = int(np.clip(distance, *_OUTLINE_LIMITS))
    limits, steep = _UNCLEAR, np.zeros(motion.size, bool)
    if motion.model == "tiles" or (motion.model != "none" and is_dim(consistent)):
        limits = _UNCLEAR_IMAGE
        may_hide = motion.model == "affine" and may_hide_displacements(consistent)
        if may_hide or unclear.any():
            template = make_template(consistent.total, threads)
            if may_hide and is_displaced(consistent, template):
                unclear = np.ones_like(unclear)
            steep = unclear & steep_pixels(template)
    clear, wider = (
        _beyond(each._replace(near_outline=near_outline), consistent, disagreements, motion.labels)
        for each in (_LIMITS, limits)
    )
    return steep | np.where(unclear, wider, clear)


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
