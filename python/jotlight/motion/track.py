"""The displacements of all blocks while they are estimated, and the paths of all pixels."""

import dataclasses
from typing import Protocol

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Blocks, Sums
from jotlight.motion.tiles import interpolate

Array = npt.NDArray[np.float64]

_MAX_KEPT_BYTES = 1 << 28
"""Maximum number of bytes of the sums of all blocks, up to which they are kept."""

_BYTES_OF_SUMS = 8
"""Bytes of the ones and trials of a pixel."""

_NEAR = 0.3
"""Change of the displacements in pixels, up to which counts are corrected to first order."""


class Counted(Protocol):
    """A motion along which blocks can be counted."""

    @property
    def blocks(self) -> Blocks: ...  # noqa: D102
    @property
    def reference(self) -> float: ...  # noqa: D102
    def sums(self, block: int) -> Sums: ...  # noqa: D102
    def displacements(self, block: int) -> npt.NDArray[np.float32]: ...  # noqa: D102


@dataclasses.dataclass(frozen=True)
class _Part:
    """Frames whose displacements are linear in time."""

    frames: range
    fields: tuple[Array, Array]
    times: tuple[float, float]

    def mean(self) -> Array:
        """Return the mean displacements of the frames, (2, rows, columns)."""
        middle = (self.frames.start + self.frames.stop - 1) / 2
        fraction = (middle - self.times[0]) / max(self.times[1] - self.times[0], 1e-9)
        return self.fields[0] + fraction * (self.fields[1] - self.fields[0])


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
    _kept: dict[int, tuple[list[_Part], Sums]] = dataclasses.field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    """The parts and the sums of blocks that were counted, so that none is counted twice."""

    def sums(self, block: int) -> Sums:
        """Return the sums of a block along the motion. Their arrays must not be changed."""
        parts = self._parts(block)
        if block in self._kept and _are_equal(self._kept[block][0], parts):
            return self._kept[block][1]
        total = Sums.zeros(self.blocks.size)
        for part in parts:
            self.blocks.add(total, part.frames, part.fields, part.times)
        if keeps_sums(self.blocks.size, len(self.nodes)):
            self._kept[block] = parts, total
        return total

    def nearby_sums(self, block: int) -> Sums:
        """Return the sums of a block along nearly the same motion, with the right remainders.

        The normal equations account for remainders to first order. So after small changes of the
        displacements, the bits need not be counted again.
        """
        if block not in self._kept:
            return self.sums(block)
        before, sums = self._kept[block]
        change = _mean(self._parts(block)) - _mean(before)
        if abs(change).max() > _NEAR:
            return self.sums(block)
        return sums.seen_along(change)

    def _parts(self, block: int) -> list[_Part]:
        """Return the parts of a block: its displacements change linearly to its neighbors'."""
        centers = self.blocks.centers
        start, end = (int(edge) for edge in self.blocks.edges[block : block + 2])
        middle = int(np.ceil(centers[block]))
        parts = []
        for frames, side in ((range(start, middle), -1), (range(middle, end), 1)):
            other = block + side
            if not (0 <= other < len(centers) and self.known[other]):
                other = block - side
            if 0 <= other < len(centers):
                first, last = sorted((block, other))
                times = float(centers[first]), float(centers[last])
            else:
                first, last, times = block, block, (float(start), float(end))
            if len(frames) > 0:
                fields = self.nodes[first].copy(), self.nodes[last].copy()
                parts.append(_Part(frames, fields, times))
        return parts

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


def keeps_sums(size: tuple[int, int], blocks: int) -> bool:
    """Return whether the sums of all blocks of an image of H x W pixels are kept."""
    return size[0] * size[1] * _BYTES_OF_SUMS * blocks <= _MAX_KEPT_BYTES


def _are_equal(first: list[_Part], second: list[_Part]) -> bool:
    """Return whether the frames of two lists of parts have the same displacements."""
    return len(first) == len(second) and all(
        one.times == other.times and np.array_equal(one.fields, other.fields)
        for one, other in zip(first, second, strict=True)
    )


def _mean(parts: list[_Part]) -> Array:
    """Return the mean displacements of the frames of all parts, (2, rows, columns)."""
    total = np.sum([len(part.frames) * part.mean() for part in parts], axis=0)
    return np.asarray(total / sum(len(part.frames) for part in parts))


def from_center(motion: Counted) -> npt.NDArray[np.intp]:
    """Return the blocks in the order of their distance from the reference time."""
    return np.argsort(abs(motion.blocks.centers - motion.reference), kind="stable")
