"""Stricter tests of bits near others that disagree: something moves there by itself.

A few bits of what moves agree with the rest by chance. The more bits nearby disagree, the more
likely this is, so the others must agree better.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Mask
from jotlight.blur import blur
from jotlight.motion.agreement.consistency import Consistent, find_consistent
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.track import Counted
from jotlight.motion.tiles import add_squares
from jotlight.squares import repeat_squares

_SPREAD, _BLOCKS = 8.0, 2.0
"""Standard deviations of the filters that average the rejected bits near a pixel of a block: in
pixels, and in blocks. What appears later rejects the bits of all blocks before, but of none
after."""

_SQUARE = 4
"""Side of the squares in which rejected bits are counted, in pixels."""

_TESTS = (0.12, (1.5, 1.2)), (0.2, (1.2, 1.05))
"""Fractions of the bits near a pixel that are rejected, above which the others must also pass a
stricter test, and its limits."""


def select_bits(paths: Counted, consistent: Consistent) -> Consistent:
    """Return the sums of the bits that are counted, among those that agree with a motion.

    Where more than 12 % of the bits nearby are rejected, in space and time, the others must also
    pass a stricter test, and an even stricter one above 20 %. All stricter tests have the usual
    rings: bits in the middle that are not tested may be wrong, too.

    Parameters
    ----------
    paths : Paths or Track
        The motion.
    consistent : Consistent
        What :func:`jotlight.motion.agreement.consistency.find_consistent` returns for it.
    """
    nearby = _rejected_nearby(consistent, paths.blocks.threads)
    masks = consistent.masks.copy()
    for fraction, limits in _TESTS:
        is_doubtful = nearby > fraction
        if is_doubtful.any():
            stricter = find_consistent(paths, limits=limits)
            masks &= stricter.masks | ~_packed(is_doubtful, paths.blocks.size)
    if (masks == consistent.masks).all():
        return consistent
    return _with_masks(paths, consistent, masks)


def _rejected_nearby(consistent: Consistent, threads: int | None) -> npt.NDArray[np.float32]:
    """Return the fraction of rejected bits near each square of each block, (n, rows, columns)."""
    from scipy.ndimage import gaussian_filter1d

    blocks = range(len(consistent.masks))
    rejected = np.stack([add_squares(~consistent.mask(block), _SQUARE) for block in blocks])
    if not rejected.any():
        return rejected
    pixels = add_squares(np.ones(consistent.accepted.shape, bool), _SQUARE)
    rejected = gaussian_filter1d(rejected / pixels, _BLOCKS, axis=0, mode="nearest")
    return blur(rejected, _SPREAD / _SQUARE, threads)


def _packed(squares: Mask, size: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Return the pixels of squares (n, rows, columns) as masks, packed as in Consistent."""
    return np.packbits(repeat_squares(squares, _SQUARE, size), axis=2)


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
