"""Stricter tests of bits near others that disagree: something moves there by itself.

A few bits of what moves agree with the rest by chance. The more bits nearby disagree, the more
likely this is, so the others must agree better.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.blur import blur
from jotlight.motion.consistency import RINGS, Consistent, find_consistent
from jotlight.motion.sums import Sums
from jotlight.motion.tiles import add_squares
from jotlight.motion.track import Counted

Mask = npt.NDArray[np.bool_]

_SPREAD, _BLOCKS = 8.0, 2.0
"""Standard deviations of the filters that average the rejected bits near a pixel of a block: in
pixels, and in blocks. What appears later rejects the bits of all blocks before, but of none
after."""

_SQUARE = 4
"""Side of the squares in which they are counted, in pixels."""

_TESTS = (0.12, (1.5, 1.2)), (0.2, (1.2, 1.05))
"""Fractions of the bits near a pixel that are rejected, above which a stricter test decides, and
its limits."""


class Selected(NamedTuple):
    """Which bits of a scene agree with its motion."""

    consistent: Consistent
    """Those that agree by the usual test."""
    counted: Consistent
    """Those of them that are counted. Near bits that disagree, they also pass stricter tests."""


def select_bits(
    paths: Counted,
    *,
    is_still: bool = False,
    rings: tuple[int, int] = RINGS,
    consistent: Consistent | None = None,
) -> Selected:
    """Return which bits of all blocks agree with a motion.

    Where more than 12 % of the bits nearby are rejected, in space and time, the others must also
    pass a stricter test, and an even stricter one above 20 %.

    Parameters
    ----------
    paths, is_still, rings
        As for :func:`jotlight.motion.consistency.find_consistent`. Stricter tests always have the
        usual rings: bits in the middle that are not tested may be wrong, too.
    consistent : Consistent, optional
        The result of this function. Default: it is computed.
    """
    if consistent is None:
        consistent = find_consistent(paths, is_still=is_still, rings=rings)
    nearby = _rejected_nearby(consistent, paths.blocks.threads)
    masks = consistent.masks.copy()
    for fraction, limits in _TESTS:
        is_doubtful = nearby > fraction
        if is_doubtful.any():
            stricter = find_consistent(paths, limits=limits)
            masks &= stricter.masks | ~_packed(is_doubtful, paths.blocks.size)
    if (masks == consistent.masks).all():
        return Selected(consistent, consistent)
    return Selected(consistent, _with_masks(paths, consistent, masks))


def _rejected_nearby(consistent: Consistent, threads: int | None) -> npt.NDArray[np.float32]:
    """Return the fraction of rejected bits near each square of each block, (n, rows, columns)."""
    from scipy.ndimage import gaussian_filter1d

    blocks = range(len(consistent.masks))
    rejected = np.stack([add_squares(~consistent.mask(block), _SQUARE) for block in blocks])
    if not rejected.any():
        return rejected
    rejected = gaussian_filter1d(rejected / _SQUARE**2, _BLOCKS, axis=0, mode="nearest")
    return blur(rejected, _SPREAD / _SQUARE, threads)


def _packed(squares: Mask, size: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Return the pixels of squares (n, rows, columns) as masks, packed as in Consistent."""
    pixels = squares.repeat(_SQUARE, axis=1).repeat(_SQUARE, axis=2)
    return np.packbits(pixels[:, : size[0], : size[1]], axis=2)


def _with_masks(paths: Counted, usual: Consistent, masks: npt.NDArray[np.uint8]) -> Consistent:
    """Return the sums of the bits of masks."""
    counted = dataclasses.replace(usual, masks=masks, outermost=())
    size = paths.blocks.size
    before, after = Sums.zeros(size), Sums.zeros(size)
    available = np.zeros(size, np.int32)
    for block, center in enumerate(paths.blocks.centers):
        sums = paths.sums(block)
        available += sums.trials
        side = after if center > paths.reference else before
        side += sums.masked(counted.mask(block))
    accepted = (before.trials + after.trials) / np.maximum(available, 1)
    return dataclasses.replace(
        counted, before=before, after=after, accepted=accepted.astype(np.float32)
    )
