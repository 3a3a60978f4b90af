"""Which bits agree with the rest: a χ² test of blocks of frames against a template."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.scoring import Template, make_template, variance_per_trial
from jotlight.motion.track import Track

Image = npt.NDArray[np.float32]

_MAX_CHI_SQUARED = 2.5
"""Pixels of a block are accepted up to this value of χ², which is about 1 if they agree."""

_SMALL_BOX, _LARGE_BOX = 3, 9
"""Widths of the squares over which residuals are added, and then their squares are averaged."""


def chi_squared(sums: Sums, template: Template) -> Image:
    """Return χ² of each pixel, (H, W), which is about 1 if the sums agree with the template."""
    p, trials = template.probability, sums.trials
    residual = sums.ones - trials * p
    variance = trials * variance_per_trial(p, trials, template)
    ratio = _box(residual, _SMALL_BOX) ** 2 / np.maximum(_box(variance, _SMALL_BOX), 1e-3)
    counted = (trials > 0).astype(np.float32)
    return (_box(ratio * counted, _LARGE_BOX) + 1) / (_box(counted, _LARGE_BOX) + 1)


def _box(image: npt.NDArray[np.floating], width: int) -> Image:
    """Return the sums over squares of a width."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(image, width, mode="reflect") * width**2, np.float32)


def merge_consistent(track: Track) -> tuple[Sums, npt.NDArray[np.float32]]:
    """Return the sums of all blocks along the motion, without pixels that disagree.

    The blocks are tested from the reference time outward, in groups of 2, 4, and 8 blocks. Each is
    tested together with its neighbors on the same side, because one block has few photons.

    Returns
    -------
    sums : Sums
        Whole numbers of ones and trials.
    accepted : ndarray of float32, shape (H, W)
        Fraction of the trials along the motion that was accepted.
    """
    order = [int(block) for block in track.from_center()]
    blocks = [track.sums(block) for block in range(len(order))]
    total = blocks[order[0]] + blocks[order[1]]
    available = total.trials.copy()
    position, group = 2, 2
    while position < len(order):
        template = make_template(total, track.blocks.threads)
        for block in order[position : position + group]:
            side = track.blocks.centers > track.reference
            near = [
                other
                for other in (block - 1, block, block + 1)
                if 0 <= other < len(order) and side[other] == side[block]
            ]
            pooled = Sums.total([blocks[other] for other in near])
            accepted = chi_squared(pooled, template) < _MAX_CHI_SQUARED
            each = blocks[block]
            available += each.trials
            total = total + Sums(
                each.ones * accepted, each.trials * accepted, each.remainders * accepted
            )
        position += group
        group = min(2 * group, 8)
    return total, np.asarray(total.trials / np.maximum(available, 1), np.float32)
