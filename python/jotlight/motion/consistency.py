"""Which bits agree with the rest: a χ² test of blocks of frames against a template."""

import dataclasses

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


@dataclasses.dataclass(frozen=True)
class Consistent:
    """The sums along a motion, without pixels of blocks that disagree."""

    total: Sums
    """Whole numbers of ones and trials."""
    accepted: Image
    """Fraction of the trials along the motion that was accepted, (H, W)."""
    masks: npt.NDArray[np.uint8]
    """The pixels that were accepted, packed, (n, H, ceil(W / 8))."""

    def mask(self, block: int) -> npt.NDArray[np.bool_]:
        """Return the pixels of a block that were accepted, (H, W)."""
        width = self.accepted.shape[1]
        return np.unpackbits(self.masks[block], axis=1, count=width).view(np.bool_)

    def count(self, motion: Counted) -> Sums:
        """Return the sums along the same motion of other data, such as one of several channels."""
        parts = Sums.zeros(motion.blocks.size)
        for block in range(len(self.masks)):
            parts = parts + motion.sums(block).masked(self.mask(block))
        return parts


def find_consistent(motion: Counted) -> Consistent:
    """Return the sums of all blocks along a motion, without pixels that disagree.

    The blocks are tested from the reference time outward, in groups of 2, 4, 8, and so on. Each is
    tested together with its neighbors on the same side, because one block has few photons.
    """
    order = [int(block) for block in from_center(motion)]
    side = motion.blocks.centers > motion.reference
    total = Sums.total([motion.sums(block) for block in order[:2]])
    available = total.trials.copy()
    height, width = motion.blocks.size
    masks = np.packbits(np.ones((len(order), height, width), bool), axis=2)
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
            total = total + each.masked(accepted)
            masks[block] = np.packbits(accepted, axis=1)
        position += group
        group *= 2
    share = np.asarray(total.trials / np.maximum(available, 1), np.float32)
    return Consistent(total, share, masks)
