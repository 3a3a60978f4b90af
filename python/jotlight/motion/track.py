"""The displacements of all blocks while they are estimated, and the paths of all pixels."""

import dataclasses
from typing import Protocol

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Blocks, Sums
from jotlight.motion.tiles import interpolate

Array = npt.NDArray[np.float64]


class Counted(Protocol):
    """A motion along which blocks can be counted."""

    @property
    def blocks(self) -> Blocks: ...  # noqa: D102
    @property
    def reference(self) -> float: ...  # noqa: D102
    def sums(self, block: int) -> Sums: ...  # noqa: D102
    def displacements(self, block: int) -> npt.NDArray[np.float32]: ...  # noqa: D102


@dataclasses.dataclass
class Track:
    """The displacements of all blocks while they are estimated."""

    blocks: Blocks
    reference: float
    nodes: Array
    """Displacements, (n, 2, rows, columns)."""
    known: npt.NDArray[np.bool_]
    """The blocks whose displacements are estimated."""
    information: Array
    """Information about the displacements in nats/px², (n, 3, rows, columns)."""

    def sums(self, block: int) -> Sums:
        """Return the sums of a block along the motion."""
        blocks, centers = self.blocks, self.blocks.centers
        start, end = (int(edge) for edge in blocks.edges[block : block + 2])
        middle = int(np.ceil(centers[block]))
        total = Sums.zeros(blocks.size)
        for frames, side in ((range(start, middle), -1), (range(middle, end), 1)):
            if len(frames) == 0:
                continue
            other = block + side
            if not (0 <= other < len(centers) and self.known[other]):
                other = block - side
            if not 0 <= other < len(centers):
                field = self.nodes[block]
                blocks.add(total, frames, (field, field), (frames.start, frames.stop))
                continue
            first, last = sorted((block, other))
            blocks.add(
                total,
                frames,
                (self.nodes[first], self.nodes[last]),
                (centers[first], centers[last]),
            )
        return total

    def displacements(self, block: int) -> npt.NDArray[np.float32]:
        """Return the displacements of all pixels in the middle of a block, (2, H, W)."""
        return interpolate(self.nodes[block], self.blocks.size)

    def from_center(self) -> npt.NDArray[np.intp]:
        """Return the blocks in the order of their distance from the reference time."""
        return from_center(self)


@dataclasses.dataclass
class Paths:
    """Tracks of which each pixel follows one."""

    tracks: list[Track]
    labels: npt.NDArray[np.uint8]
    """Index of the track of each pixel, (H, W)."""

    @property
    def blocks(self) -> Blocks:
        """The burst."""
        return self.tracks[0].blocks

    @property
    def reference(self) -> float:
        """Time at which displacements are 0."""
        return self.tracks[0].reference

    def sums(self, block: int) -> Sums:
        """Return the sums of a block, of each pixel along its own track."""
        if len(self.tracks) == 1:
            return self.tracks[0].sums(block)
        return Sums.select([track.sums(block) for track in self.tracks], self.labels)

    def displacements(self, block: int) -> npt.NDArray[np.float32]:
        """Return the displacements of all pixels in the middle of a block, (2, H, W)."""
        fields = [track.displacements(block) for track in self.tracks]
        return np.choose(self.labels, fields) if len(fields) > 1 else fields[0]


def from_center(motion: Counted) -> npt.NDArray[np.intp]:
    """Return the blocks in the order of their distance from the reference time."""
    return np.argsort(abs(motion.blocks.centers - motion.reference), kind="stable")
