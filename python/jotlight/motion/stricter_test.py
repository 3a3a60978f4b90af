"""A stricter test of bits near others that disagree: something moves there by itself.

A few bits of what moves agree with the rest by chance. Near others that disagree, this is likely,
so such bits must agree better.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.blur import blur
from jotlight.motion.consistency import RINGS, Consistent, find_consistent
from jotlight.motion.sums import Sums
from jotlight.motion.tiles import add_squares
from jotlight.motion.track import Counted

_SPREAD, _BLOCKS = 8.0, 2.0
"""Standard deviations of the filters that average the rejected bits near a pixel of a block: in
pixels, and in blocks. What appears later rejects the bits of all blocks before, but of none
after."""

_SQUARE = 4
"""Side of the squares in which they are counted, in pixels."""

_MAX_REJECTED = 0.12
"""Fraction of the bits near a pixel that are rejected, above which the stricter test decides."""


class Selected(NamedTuple):
    """Which bits of a scene agree with its motion."""

    consistent: Consistent
    """Those that agree by the usual test."""
    counted: Consistent
    """Those of them that are counted. Near bits that disagree, they passed a stricter test."""


def select_bits(
    paths: Counted,
    *,
    is_still: bool = False,
    rings: tuple[int, int] = RINGS,
    consistent: Consistent | None = None,
) -> Selected:
    """Return which bits of all blocks agree with a motion.

    Where more than 12 % of the bits nearby are rejected, in space and time, the others must also
    pass a stricter test.

    Parameters
    ----------
    paths, is_still, rings
        As for :func:`jotlight.motion.consistency.find_consistent`. The stricter test always has the
        usual rings: bits in the middle that are not tested may be wrong, too.
    consistent : Consistent, optional
        The result of this function. Default: it is computed.
    """
    if consistent is None:
        consistent = find_consistent(paths, is_still=is_still, rings=rings)
    is_doubtful = _rejected_nearby(consistent, paths.blocks.threads) > _MAX_REJECTED
    if not is_doubtful.any():
        return Selected(consistent, consistent)
    stricter = find_consistent(paths, is_strict=True)
    return Selected(consistent, _join(paths, consistent, stricter, is_doubtful))


def _rejected_nearby(consistent: Consistent, threads: int | None) -> npt.NDArray[np.float32]:
    """Return the fraction of rejected bits near each square of each block, (n, rows, columns)."""
    from scipy.ndimage import gaussian_filter1d

    blocks = range(len(consistent.masks))
    rejected = np.stack([add_squares(~consistent.mask(block), _SQUARE) for block in blocks])
    if not rejected.any():
        return rejected
    rejected = gaussian_filter1d(rejected / _SQUARE**2, _BLOCKS, axis=0, mode="nearest")
    return blur(rejected, _SPREAD / _SQUARE, threads)


def _join(
    paths: Counted,
    usual: Consistent,
    stricter: Consistent,
    is_doubtful: npt.NDArray[np.bool_],
) -> Consistent:
    """Return the sums of the bits that pass the usual test, and in some squares also another."""
    size, masks = paths.blocks.size, usual.masks.copy()
    before, after = Sums.zeros(size), Sums.zeros(size)
    available = np.zeros(size, np.int32)
    for block, squares in enumerate(is_doubtful):
        doubtful = squares.repeat(_SQUARE, axis=0).repeat(_SQUARE, axis=1)[: size[0], : size[1]]
        mask = usual.mask(block) & (stricter.mask(block) | ~doubtful)
        masks[block] = np.packbits(mask, axis=1)
        sums = paths.sums(block)
        available += sums.trials
        side = after if paths.blocks.centers[block] > paths.reference else before
        side += sums.masked(mask)
    accepted = (before.trials + after.trials) / np.maximum(available, 1)
    return Consistent(before, after, accepted.astype(np.float32), masks, usual.lights)
