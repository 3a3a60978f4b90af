"""The displacements of all blocks while they are estimated."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Blocks, Sums

Array = npt.NDArray[np.float64]


@dataclasses.dataclass
class Track:
    """The displacements of all blocks while they are estimated."""

    blocks: Blocks
    reference: int
    nodes: Array
    """Displacements, (n, 2, rows, columns)."""
    known: npt.NDArray[np.bool_]
    """The blocks whose displacements are estimated."""

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
            first, last = sorted((block, other))
            blocks.add(
                total,
                frames,
                (self.nodes[first], self.nodes[last]),
                (centers[first], centers[last]),
            )
        return total

    def from_center(self) -> npt.NDArray[np.intp]:
        """Return the blocks in the order of their distance from the reference time."""
        return np.argsort(abs(self.blocks.centers - self.reference), kind="stable")
