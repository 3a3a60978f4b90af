"""Which bits agree with the rest: a χ² test of blocks of frames against a template."""

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.motion.blocks import Sums
from jotlight.motion.scoring import Template, make_template
from jotlight.motion.track import Counted, from_center

Image = npt.NDArray[np.float32]

_MAX_CHI_SQUARED = 2.5
"""Pixels of a block are accepted up to this value of χ², which is about 1 if they agree."""


def chi_squared(sums: Sums, template: Template) -> Image:
    """Return χ² of each pixel, (H, W), which is about 1 if the sums agree with the template.

    Residual counts and their variances are added in squares of 3 pixels. The ratios of the squared
    residuals to the variances are averaged in squares of 9 pixels.
    """
    out = np.empty(sums.ones.shape, np.float32)
    engine.chi_squared(
        sums.ones, sums.trials, template.probability, template.trials, out, template.threads
    )
    return out


def merge_consistent(motion: Counted) -> tuple[Sums, npt.NDArray[np.float32]]:
    """Return the sums of all blocks along a motion, without pixels that disagree.

    The blocks are tested from the reference time outward, in groups of 2, 4, 8, and so on. Each is
    tested together with its neighbors on the same side, because one block has few photons.

    Returns
    -------
    sums : Sums
        Whole numbers of ones and trials.
    accepted : ndarray of float32, shape (H, W)
        Fraction of the trials along the motion that was accepted.
    """
    order = [int(block) for block in from_center(motion)]
    side = motion.blocks.centers > motion.reference
    total = motion.sums(order[0]) + motion.sums(order[1])
    available = total.trials.copy()
    position, group = 2, 2
    while position < len(order):
        template = make_template(total, motion.blocks.threads)
        for block in order[position : position + group]:
            near = [
                motion.sums(other)
                for other in (block - 1, block + 1)
                if 0 <= other < len(order) and side[other] == side[block]
            ]
            each = motion.sums(block)
            accepted = chi_squared(Sums.total([each, *near]), template) < _MAX_CHI_SQUARED
            available += each.trials
            total = total + Sums(
                each.ones * accepted, each.trials * accepted, each.remainders, each.frames
            )
        position += group
        group *= 2
    return total, np.asarray(total.trials / np.maximum(available, 1), np.float32)
