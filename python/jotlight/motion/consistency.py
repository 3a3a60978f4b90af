"""Which bits agree with the rest: a χ² test of blocks of frames against a template."""

import dataclasses
import functools
import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.blur import blur
from jotlight.motion.blocks import Sums
from jotlight.motion.equivalent import equivalent_sums, estimate_probability
from jotlight.motion.flicker import at_brightness, change_of_light, min_change, without_saturation
from jotlight.motion.lights import BlockLights, Lights
from jotlight.motion.scoring import (
    FAST,
    PRECISE,
    Template,
    make_template,
    without_shift,
)
from jotlight.motion.track import Counted, from_center

Image = npt.NDArray[np.float32]

_LIMITS = 2.5, 1.4
"""Pixels of a block are accepted up to this value of χ², which is about 1 if they agree.

Pixels of one side of a ring are accepted up to the second value.
"""

_LIMITS_IF_STILL = 4.5, 1.6
"""The same for a scene that stands still, where no motion can be wrong.

Dim scenes exceed 3.5 by chance in some pixels of most images.
"""

_FIRST_RING = 2
"""Number of blocks in the middle, which are not tested."""

_ROUNDS_OF_LIGHT = 3
"""Rounds in which the light of the first blocks is found: each uses that of the others."""

_SPREAD = 8.0
"""Standard deviation of the filter that averages the disagreement, in pixels."""

_SQUARE = 4
"""Side of the squares over which the engine adds the disagreement, in pixels."""

_MAX_TRIALS = 512
"""Maximum number of trials in a test. More trials count as this number of them.

They would show errors that do not matter, such as those of rounding to whole pixels.
"""

_FEW_TRIALS = 128
"""Number of trials above which a test notices that rounding has shifted a block."""

_BLOCKS_AT_ONCE = 16
"""Number of blocks that are tested together, and in memory together if their sums are not kept."""

_PRIOR = 0.01
"""Weight with which pixels are assumed to agree where few are known."""


def chi_squared(sums: Sums, template: Template) -> Image:
    """Return χ² of each pixel, (H, W), which is about 1 if the sums agree with the template.

    Residual counts and their variances are added in squares of 3 pixels. The ratios of the squared
    residuals to the variances are averaged in squares of 9 pixels. If there are many trials, the
    template is shifted as rounding has shifted the sums.
    """
    probability, threads = template.probability, template.threads
    if sums.trials.max() > _FEW_TRIALS:
        moved = dataclasses.replace(sums, remainders=-sums.remainders)
        probability = without_shift(probability, moved, threads).probability
    sums = equivalent_sums(_limit_trials(sums), probability)
    out = np.empty_like(probability)
    engine.chi_squared(sums.ones, sums.trials, probability, template.trials, out, threads)
    return out


def disagreement(first: Sums, second: Sums, threads: int | None = None) -> Image:
    """Return how much two parts of the frames disagree around each pixel, (H, W).

    It is the square of the difference of their counts in units of its variance, averaged over many
    pixels: about 1 if they agree. One may be brighter than the other, by the same factor
    everywhere. Squares of 4 pixels have equal values.
    """
    height, width = first.ones.shape
    squares = np.empty((2, -(-height // _SQUARE), -(-width // _SQUARE)), np.float32)
    first, second = _limit_trials(first), _limit_trials(second)
    if first.jots is not None or second.jots is not None:
        probability = estimate_probability(first + second)
        # One of them may have no bits, and so no jots.
        first, second = (equivalent_sums(each, probability).real() for each in (first, second))
    engine.disagreement(first.ones, first.trials, second.ones, second.trials, squares, threads)
    ratios, known = blur(squares / _SQUARE**2, _SPREAD / _SQUARE, threads)
    values = (ratios + _PRIOR) / (known + _PRIOR)
    pixels = values.repeat(_SQUARE, axis=0).repeat(_SQUARE, axis=1)
    return np.asarray(pixels[:height, :width])


def _limit_trials(sums: Sums) -> Sums:
    """Return sums with at most :data:`_MAX_TRIALS` trials per pixel."""
    largest = int(sums.trials.max())
    if largest <= _MAX_TRIALS:
        return sums
    factor = np.float32(_MAX_TRIALS / largest)
    parts: list[Any] = [factor * sums.ones, factor * sums.trials]
    if sums.ones.dtype == np.int32:  # equivalent counts are real numbers
        parts = [np.rint(each).astype(np.int32) for each in parts]
    ones, trials = parts
    jots = None if sums.jots is None else sums.jots * (trials / np.maximum(sums.trials, 1))
    return dataclasses.replace(sums, ones=ones, trials=trials, jots=jots)


@dataclasses.dataclass(frozen=True)
class Consistent:
    """The sums along a motion, without pixels of blocks that disagree."""

    before: Sums
    after: Sums
    """The sums of the blocks before and after the reference time."""
    accepted: Image
    """Fraction of the trials along the motion that was accepted, (H, W)."""
    masks: npt.NDArray[np.uint8]
    """The pixels that were accepted, packed, (n, H, ceil(W / 8))."""
    lights: tuple[Lights, Lights] | None = None
    """The light of the frames before and after the reference time, if jots need several photons."""

    @functools.cached_property
    def total(self) -> Sums:
        """The sums of all blocks: whole numbers of ones and trials."""
        return self.before + self.after

    def mask(self, block: int) -> npt.NDArray[np.bool_]:
        """Return the pixels of a block that were accepted, (H, W)."""
        width = self.accepted.shape[1]
        return np.unpackbits(self.masks[block], axis=1, count=width).view(np.bool_)

    def count(self, paths: Counted) -> Sums:
        """Return the sums along the same motion of other data, such as one of several channels."""
        total = Sums.zeros(paths.blocks.size)
        for block in range(len(self.masks)):
            total += paths.sums(block).masked(self.mask(block))
        return total


def find_consistent(
    paths: Counted, *, is_still: bool = False, network: str = PRECISE
) -> Consistent:
    """Return the sums of all blocks along a motion, without pixels that disagree.

    The blocks are tested from the reference time outward, in rings of 2, 4, 8, and so on. First,
    each block is compared with all that are nearer. It is tested together with its neighbors on
    the same side, because one block has few photons. Then the two sides of the ring are compared
    with all nearer blocks. This detects small errors of the motion that grow with time.

    Parameters
    ----------
    paths : Counted
        The paths of all pixels.
    is_still : bool
        Whether nothing moves. Then fewer pixels are rejected.
    network : str
        Name of the network that denoises the last template. Half of the blocks are compared with
        this template. The network ``templates`` denoises the others.
    """
    max_chi_squared, max_disagreement = _LIMITS_IF_STILL if is_still else _LIMITS
    order = [int(block) for block in from_center(paths)]
    is_after = paths.blocks.centers > paths.reference
    size, threads = paths.blocks.size, paths.blocks.threads
    masks = np.tile(np.packbits(np.ones(size, bool), axis=1), (len(order), 1, 1))
    sides = [Sums.zeros(size), Sums.zeros(size)]
    available = np.zeros(size, np.int32)
    for block in order[:_FIRST_RING]:
        sums = paths.sums(block)
        available += sums.trials
        sides[int(is_after[block])] += sums
    start, lights = _FIRST_RING, _first_lights(paths, order[:_FIRST_RING])
    while start < len(order):
        ring = order[start : 2 * start]
        nearer = sides[0] + sides[1]
        is_last = 2 * start >= len(order)
        template = make_template(nearer, threads, network if is_last else FAST)
        if lights is not None:
            known = _find_lights(lights, paths, template, order[:start], ring)
            template = dataclasses.replace(template, lights=known)
        for side in (0, 1):
            blocks = [block for block in ring if is_after[block] == side]
            total = Sums.zeros(size)
            tested = _with_neighbors(paths, blocks, is_after == bool(side))
            while several := list(itertools.islice(tested, _BLOCKS_AT_ONCE)):
                add_agreeing(total, several, template, max_chi_squared, masks, available)
            both = None if lights is None else (lights.of(order[:start]), lights.of(blocks))
            test = disagreement(*without_saturation(nearer, total, threads, both), threads)
            agrees = np.empty_like(masks[0])
            sides[side].add_accepted(total, test, max_disagreement, agrees, threads)
            masks[blocks] &= agrees
        start *= 2
    trials = sides[0].trials + sides[1].trials
    share = np.asarray(trials / np.maximum(available, 1), np.float32)
    both = None
    if lights is not None:
        both = lights.of(np.flatnonzero(~is_after)), lights.of(np.flatnonzero(is_after))
    return Consistent(sides[0], sides[1], share, masks, both)


def _first_lights(paths: Counted, blocks: list[int]) -> BlockLights | None:
    """Return the light of the first blocks, or None if a single photon makes a jot report 1."""
    threshold = paths.blocks.burst.threshold
    if threshold == 1:
        return None
    return BlockLights(threshold, np.diff(paths.blocks.edges).tolist(), blocks)


def _find_lights(
    lights: BlockLights, paths: Counted, template: Template, nearer: list[int], ring: list[int]
) -> Lights:
    """Find the light of the blocks of a ring, and return that of the template of nearer ones."""
    rounds = _ROUNDS_OF_LIGHT if len(nearer) == _FIRST_RING else 1
    # A template of more blocks also shows the light of the nearer ones better.
    for blocks in [*[nearer] * rounds, ring]:
        known = dataclasses.replace(template, lights=lights.of(nearer))
        lights.factors |= {each: change_of_light(known, paths.sums(each)) for each in blocks}
    return lights.of(nearer)


@dataclasses.dataclass(frozen=True, eq=False)
class ComparedBlock:
    """A block that is tested together with its neighbors."""

    block: int
    near: list[Sums]
    """The sums of the block and of its neighbors."""
    index: int
    """The index of the block among them."""
    max_trials: int
    """A pixel of their sum has no more trials than these."""

    @property
    def sums(self) -> Sums:
        """The sums of the block."""
        return self.near[self.index]

    @property
    def is_plain(self) -> bool:
        """Whether there are only few bits, of jots that are alike, so that nothing changes them."""
        jots_differ = any(each.jots is not None for each in self.near)
        return not jots_differ and self.max_trials <= _FEW_TRIALS


def add_agreeing(
    total: Sums,
    tested: list[ComparedBlock],
    template: Template,
    limit: float,
    masks: npt.NDArray[np.uint8],
    available: npt.NDArray[np.int32],
) -> None:
    """Add the counts of blocks to a total where χ² of each and its neighbors is below a limit.

    Parameters
    ----------
    total : Sums
        The total.
    tested : list of ComparedBlock
        The blocks.
    template : Template
        The template.
    limit : float
        The limit.
    masks : ndarray of uint8, shape (n, H, ceil(W / 8))
        Packed masks of all blocks, whose bits are set where the counts are added, and cleared
        elsewhere.
    available : ndarray of int32, shape (H, W)
        Number of trials, to which all of the blocks are added.
    """
    threads = template.threads
    plain = [each for each in tested if each.is_plain]
    is_added = engine.accept_agreeing(
        (template.probability, template.trials),
        (limit, min_change(template)),
        [
            ([(near.ones, near.trials) for near in each.near], each.index, masks[each.block])
            for each in plain
        ],
        (total.ones, total.trials),
        available,
        threads,
    )
    added = [each for each, done in zip(plain, is_added, strict=True) if done]
    for each in tested:
        if each in added:
            total.remainders += each.sums.remainders
            total.frames += each.sums.frames
            continue
        pooled = equivalent_sums(Sums.total(each.near, threads), template.probability)
        test = chi_squared(pooled, at_brightness(template, pooled))
        available += each.sums.trials
        total.add_accepted(each.sums, test, limit, masks[each.block], threads)


def _with_neighbors(
    paths: Counted, blocks: list[int], on_side: npt.NDArray[np.bool_]
) -> Iterator[ComparedBlock]:
    """Yield blocks with the neighbors on the same side."""
    counted: dict[int, Sums] = {}
    for block in sorted(blocks):
        near = [
            other
            for other in (block - 1, block, block + 1)
            if 0 <= other < len(on_side) and on_side[other]
        ]
        counted = {other: counted.get(other) or paths.sums(other) for other in near}
        sums = list(counted.values())
        max_trials = paths.blocks.trials * sum(each.frames for each in sums)
        yield ComparedBlock(block, sums, near.index(block), max_trials)
