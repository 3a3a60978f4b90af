"""The displacements of all blocks while they are estimated, and the paths of all pixels."""

import dataclasses
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.kept_sums import Curve, KeptSums, keeps_sums
from jotlight.motion.counts.sums import Sums
from jotlight.motion.labels import choose
from jotlight.motion.tiles import interpolate, tile_counts

_SAME, _NEAR = 0.1, 0.5
"""Changes of the displacements in pixels up to which bits are not counted again.

The first one hardly changes counts: rounding displaces a bit by 0.3 pixels on average. Up to the
second one, equations about displacements account for the change to first order.
"""


class Counted(Protocol):
    """A track, paths, or another motion along which blocks can be counted."""

    @property
    def blocks(self) -> Blocks: ...  # noqa: D102
    @property
    def reference(self) -> float: ...  # noqa: D102
    def sums(self, block: int) -> Sums: ...  # noqa: D102
    def displacements(self, block: int, step: int = 1) -> npt.NDArray[np.float32]: ...  # noqa: D102


@dataclasses.dataclass
class Track:
    """The displacements of all blocks while they are estimated."""

    blocks: Blocks
    reference: float
    """Time at which displacements are 0."""
    nodes: Array
    """Displacements, (n, 2, rows, columns)."""
    known: npt.NDArray[np.bool_]
    """The blocks whose displacements are estimated."""
    information: Array
    """Information about the displacements in nats/px², (n, 3, rows, columns)."""
    pixels: npt.NDArray[np.bool_] | None = None
    """The pixels that are counted, (H, W). Default: all."""
    freedom: float = 0.0
    """How many deviations of tiles the bits determine, if tiles move by themselves."""
    tolerance: float = _SAME
    """Change of the displacements in pixels up to which :meth:`sums` does not count bits again."""
    _kept: KeptSums = dataclasses.field(
        default_factory=KeptSums, init=False, repr=False, compare=False
    )
    """The sums of blocks that were counted. Tracks over the same frames may share them."""

    @classmethod
    def still(cls, blocks: Blocks) -> Self:
        """Return the track of a scene that stands still."""
        shape, number = tile_counts(blocks.size), len(blocks.centers)
        nodes, information = np.zeros((number, 2, *shape)), np.zeros((number, 3, *shape))
        return cls(blocks, blocks.middle, nodes, np.ones(number, bool), information)

    def over(self, blocks: Blocks) -> "Track":
        """Return the same motion over other frames of the same blocks."""
        return self if blocks.step == self.blocks.step else dataclasses.replace(self, blocks=blocks)

    def inside(self, pixels: npt.NDArray[np.bool_] | None) -> "Track":
        """Return the same motion, where only some pixels (H, W) are counted, or all for None."""
        return self._sharing(dataclasses.replace(self, pixels=pixels))

    def exact(self, blocks: Blocks) -> "Track":
        """Return the track that a motion holds, over other frames of the same blocks.

        Its displacements have single precision, and bits are counted along exactly these.
        """
        nodes = self.nodes.astype(np.float32).astype(np.float64)
        exact = dataclasses.replace(self, blocks=blocks, nodes=nodes, tolerance=0.0)
        return self._sharing(exact) if blocks.step == self.blocks.step else exact

    def _sharing(self, other: "Track") -> "Track":
        """Return another track over the same frames, which shares the sums that are kept."""
        other._kept = self._kept
        return other

    def sums(self, block: int) -> Sums:
        """Return the sums of a block along the motion. Their arrays must not be changed."""
        return self._sums_within(self.tolerance, block)

    def nearby_sums(self, block: int) -> Sums:
        """Return the sums of a block along nearly the same motion, with the right remainders.

        The normal equations account for remainders to first order. So after small changes of the
        displacements, the bits need not be counted again.
        """
        return self._sums_within(_NEAR, block)

    def _sums_within(self, distance: float, block: int) -> Sums:
        """Return the sums of a block, counted along displacements up to a distance away."""
        curve = self._curve(block)
        sums = self._kept.seen_along(block, curve, distance)
        if sums is None:
            sums = self.blocks.count(curve.frames, curve.fields, curve.times)
            jots_differ = self.blocks.jots is not None
            if keeps_sums(self.blocks.size, len(self.nodes), jots_differ=jots_differ):
                self._kept.keep(block, curve, sums)
        return sums if self.pixels is None else sums.masked(self.pixels)

    def _curve(self, block: int) -> Curve:
        """Return the displacements of a block, which change linearly to its known neighbors'."""
        first, end = block, block + 1
        if first > 0 and self.known[first - 1]:
            first -= 1
        if end < len(self.nodes) and self.known[end]:
            end += 1
        fields, times = self.nodes[first:end].copy(), self.blocks.centers[first:end]
        if len(fields) == 1:
            fields = fields.repeat(2, axis=0)
            times = self.blocks.edges[block : block + 2].astype(np.float64)
        return Curve(self.blocks.frames(block), fields, times)

    def displacements(self, block: int, step: int = 1) -> npt.NDArray[np.float32]:
        """Return the displacements of all pixels in the middle of a block, (2, H, W).

        Or only those of every second, third, or nth row and column.
        """
        return interpolate(self.nodes[block], self.blocks.size, step)

    def velocity(self) -> Array:
        """Return the velocity of each tile at the reference time, (2, rows, columns)."""
        before, after = sorted(int(block) for block in from_center(self)[:2])
        centers = self.blocks.centers
        step = self.nodes[after] - self.nodes[before]
        return np.asarray(step / (centers[after] - centers[before]))


@dataclasses.dataclass
class Paths:
    """Tracks of which each pixel follows one."""

    tracks: list[Track]
    labels: npt.NDArray[np.uint8]
    """Index of the track of each pixel, (H, W)."""
    free: int = 0
    """Number of tracks at the end that hide nothing, and are not hidden. The others are in their
    order from back to front."""

    @property
    def blocks(self) -> Blocks:
        """The burst."""
        return self.tracks[0].blocks

    @property
    def reference(self) -> float:
        """Time at which displacements are 0."""
        return self.tracks[0].reference

    def exact(self) -> "Paths":
        """Return the paths that a motion holds, over all frames of the blocks.

        So the sums along them are those along the motion, whoever merges it.
        """
        blocks = dataclasses.replace(self.blocks, step=1)
        return dataclasses.replace(self, tracks=[track.exact(blocks) for track in self.tracks])

    def sums(self, block: int) -> Sums:
        """Return the sums of a block, of each pixel along its own track while it is not hidden."""
        if len(self.tracks) == 1:
            return self.tracks[0].sums(block)
        sums = Sums.select([track.sums(block) for track in self.tracks], self.labels)
        hidden = self._hidden(block)
        central = from_center(self)[:2]
        if block in central:
            # Each pixel has some bits, even in holes that are smaller than the motion of a block.
            hidden &= ~np.logical_and.reduce([self._hidden(int(each)) for each in central])
        return sums.masked(~hidden) if hidden.any() else sums

    def _hidden(self, block: int) -> npt.NDArray[np.bool_]:
        """Return the pixels that something in front of their own track hides in a block, (H, W)."""
        hidden = np.zeros(self.labels.shape, bool)
        for index in range(len(self.tracks) - self.free - 1):
            hidden |= (self.labels == index) & self.covered(index, block)
        return hidden

    def covered(self, index: int, block: int) -> npt.NDArray[np.bool_]:
        """Return whether pixels that follow a track are behind others in a block, (H, W)."""
        covered = np.zeros(self.labels.shape, bool)
        segments = range(index + 1, len(self.tracks) - self.free)
        fronts = [(front, self.relative(index, front, block)) for front in segments]
        engine.mark_covered(fronts, self.labels, covered, self.blocks.threads)
        return covered

    def relative(self, index: int, other: int, block: int) -> npt.NDArray[np.float32]:
        """Return how far the pixels of another track that have the same positions are.

        These are the distances at the centers of tiles, (2, rows, columns). Motions are so smooth
        that the displacement of such a pixel is nearly that of the first one.
        """
        nodes = self.tracks[index].nodes[block] - self.tracks[other].nodes[block]
        return np.asarray(nodes, np.float32)

    def displacements(self, block: int, step: int = 1) -> npt.NDArray[np.float32]:
        """Return the displacements of all pixels in the middle of a block, (2, H, W).

        Or only those of every second, third, or nth row and column.
        """
        fields = [track.displacements(block, step) for track in self.tracks]
        return choose(self.labels[::step, ::step], fields)


def from_center(paths: Counted) -> npt.NDArray[np.intp]:
    """Return the blocks in the order of their distance from the reference time.

    Those without light are the last ones.
    """
    return np.lexsort((abs(paths.blocks.centers - paths.reference), ~paths.blocks.is_lit))
