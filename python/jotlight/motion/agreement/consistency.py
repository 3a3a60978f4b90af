"""Which bits agree with the rest: a χ² test of blocks of frames against a template."""

import dataclasses
import itertools
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Image
from jotlight.kept import kept_property
from jotlight.motion.counts.equivalent import equivalent_sums
from jotlight.motion.counts.lights import BlockLights, Lights
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.disagreement import FEW_TRIALS, chi_squared, disagreement
from jotlight.motion.displacements.flicker import (
    at_brightness,
    change_of_light,
    min_change,
    without_saturation,
)
from jotlight.motion.displacements.scoring import FAST, Template, make_template
from jotlight.motion.displacements.track import Counted, from_center

_LIMITS = 2.5, 1.4
"""Pixels of a block are accepted up to this value of χ², which is about 1 if they agree.

Pixels of one side of a ring are accepted up to the second value.
"""

_LIMITS_IF_STILL = 4.5, 1.6
"""The same for a scene that stands still, where no motion can be wrong.

With a limit of 3.5, some pixels of most dim images would exceed it by chance.
"""

RINGS = 2, 2
"""Number of blocks in the middle, which are not tested, and by which factor each ring increases the
number of blocks."""

_ROUNDS_OF_LIGHT = 3
"""Rounds in which the light of the first blocks is found: each uses that of the others."""

CLEARLY_MORE = 0.003
"""Difference of the fractions of bits that agree with two motions, above which one is better,
although the bits may be more likely along the other one. Likelihoods do not show whether outlines
and tiles have the right places at the end of a burst."""

MIN_ACCEPTED = 0.6
"""Fraction of the bits of a pixel that must agree with the rest, for its motion to be known."""

_BLOCKS_AT_ONCE = 16
"""Number of blocks that are tested together, and in memory together if their sums are not kept."""


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
    outermost: tuple[Sums, ...] = ()
    """The sums of the blocks that are farthest from the reference time: of the last ring, on each
    side of it. They contain all pixels of a block that agree with the template."""

    @kept_property
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
    paths: Counted,
    *,
    is_still: bool = False,
    limits: tuple[float, float] | None = None,
    rings: tuple[int, int] = RINGS,
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
    limits : (float, float), optional
        The values of χ² up to which pixels of a block, and of one side of a ring, are accepted.
        Default: the usual ones.
    rings : (int, int)
        Number of blocks in the middle, which are not tested, and by which factor each ring
        increases the number of blocks.
    """
    order = [int(block) for block in from_center(paths)]
    usual, (start, growth) = _LIMITS_IF_STILL if is_still else _LIMITS, rings
    tested = _TestedBlocks(paths, order[:start], limits or usual)
    while start < len(order):
        end = growth * start
        tested.add_ring(order[start:end])
        start = end
    return tested.result()


class _TestedBlocks:
    """The sums of the blocks that were tested so far, from the reference time outward.

    Parameters
    ----------
    paths : Counted
        The paths of all pixels.
    first : list of int
        The blocks in the middle, which are not tested.
    limits : (float, float)
        The largest χ² of a block, and the largest disagreement of one side of a ring.
    """

    def __init__(self, paths: Counted, first: list[int], limits: tuple[float, float]) -> None:
        self._paths, self._blocks = paths, list(first)
        self._max_chi_squared, self._max_disagreement = limits
        self._size, self._threads = paths.blocks.size, paths.blocks.threads
        self._is_after = paths.blocks.centers > paths.reference
        all_pixels = np.packbits(np.ones(self._size, bool), axis=1)
        self._masks = np.tile(all_pixels, (len(self._is_after), 1, 1))
        self._lights, self._untested = _first_lights(paths, first), len(first)
        self._available = np.zeros(self._size, np.int32)
        """The trials of all blocks, whether or not they were accepted."""
        self._sides = [Sums.zeros(self._size), Sums.zeros(self._size)]
        """The accepted sums before and after the reference time."""
        self._outermost: tuple[Sums, ...] = ()
        for block in first:
            sums = paths.sums(block)
            self._available += sums.trials
            self._sides[int(self._is_after[block])] += sums

    def add_ring(self, ring: list[int]) -> None:
        """Test the blocks of a ring, and add what agrees with a template of all nearer blocks."""
        nearer = self._sides[0] + self._sides[1]
        template = make_template(nearer, self._threads, FAST)
        if self._lights is not None:
            rounds = _ROUNDS_OF_LIGHT if len(self._blocks) == self._untested else 1
            lights = _find_lights(self._lights, self._paths, template, self._blocks, ring, rounds)
            template = dataclasses.replace(template, lights=lights)
        self._outermost = ()
        for side in (0, 1):
            blocks = [block for block in ring if self._is_after[block] == side]
            total = self._agreeing(blocks, side, template)
            both = _both_lights(self._lights, self._blocks, blocks)
            halves = without_saturation(nearer, total, self._threads, both)
            test = disagreement(*halves, self._threads)
            agrees = np.empty_like(self._masks[0])
            limit = self._max_disagreement
            self._sides[side].add_accepted(total, test, limit, agrees, self._threads)
            self._masks[blocks] &= agrees
            self._outermost += (total,)
        self._blocks += ring

    def _agreeing(self, blocks: list[int], side: int, template: Template) -> Sums:
        """Return the sums of blocks on one side where they agree with a template."""
        total, limit = Sums.zeros(self._size), self._max_chi_squared
        tested = _with_neighbors(self._paths, blocks, self._is_after == bool(side))
        while several := list(itertools.islice(tested, _BLOCKS_AT_ONCE)):
            add_agreeing(total, several, template, limit, self._masks, self._available)
        return total

    def result(self) -> Consistent:
        """Return the sums of all blocks."""
        before, after = self._sides
        trials = before.trials + after.trials
        available = np.maximum(self._available, 1)
        accepted = np.divide(trials, available, dtype=np.float32, casting="unsafe")
        sides = np.flatnonzero(~self._is_after), np.flatnonzero(self._is_after)
        lights = _both_lights(self._lights, *sides)
        return Consistent(before, after, accepted, self._masks, lights, self._outermost)


def _first_lights(paths: Counted, blocks: list[int]) -> BlockLights | None:
    """Return the light of the first blocks, or None if a single photon makes a jot report 1."""
    threshold = paths.blocks.burst.threshold
    if threshold == 1:
        return None
    return BlockLights(threshold, np.diff(paths.blocks.edges).tolist(), blocks)


def _both_lights(
    lights: BlockLights | None, first: Iterable[int], second: Iterable[int]
) -> tuple[Lights, Lights] | None:
    """Return the light of two parts of the blocks, or None if the light does not matter."""
    return None if lights is None else (lights.of(first), lights.of(second))


def _find_lights(
    lights: BlockLights,
    paths: Counted,
    template: Template,
    nearer: list[int],
    ring: list[int],
    rounds: int,
) -> Lights:
    """Find the light of the blocks of a ring, and return that of the template of nearer ones.

    The light of the nearer ones is found anew in each round.
    """
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
        return not jots_differ and self.max_trials <= FEW_TRIALS


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
