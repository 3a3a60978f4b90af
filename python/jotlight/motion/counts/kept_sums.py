"""Sums of blocks that are kept while their displacements change."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from jotlight.array_types import Array
from jotlight.kept import kept_property
from jotlight.motion.counts.frame_times import locate
from jotlight.motion.counts.sums import Sums

_MAX_KEPT_BYTES = 1 << 28
"""Maximum number of bytes of the sums of all blocks, up to which they are kept."""

_BYTES_OF_SUMS, _BYTES_OF_JOTS = 8, 8
"""Bytes of the ones and trials of a pixel, and of what it has seen of jots that differ."""


@dataclasses.dataclass(frozen=True)
class Curve:
    """Displacements of the frames of a block, which are linear between two fields."""

    frames: range
    fields: Array
    """Displacements of the tiles, (n, 2, rows, columns)."""
    times: Array
    """The times of the fields, (n,)."""

    @kept_property
    def mean(self) -> Array:
        """The mean displacements of the frames, (2, rows, columns)."""
        weights = _mean_weights(self.frames, tuple(self.times.tolist()))
        mean = weights @ self.fields.reshape(len(weights), -1)
        return np.asarray(mean.reshape(self.fields.shape[1:]))

    def distance(self, other: "Curve") -> float:
        """Return the largest difference of the displacements in pixels.

        It is that of the fields, or of the first, the middle, and the last frame if there are not
        equally many fields. Then it is never 0, because other fields round differently.
        """
        if len(self.times) == len(other.times):
            return float(abs(self.fields - other.fields).max())
        first, last = self.frames[0], self.frames[-1]
        three = first, (first + last) / 2, last
        one, two = (
            _weights(three, tuple(each.times.tolist())) @ each.fields.reshape(len(each.fields), -1)
            for each in (self, other)
        )
        return max(float(abs(one - two).max()), np.finfo(float).tiny)


class KeptSums:
    """The latest sums of each block, so that nearly the same bits are not counted again."""

    def __init__(self) -> None:
        self._sums: dict[int, tuple[Curve, Sums]] = {}
        """The sums of blocks, and the curves along which they were counted."""
        self._latest: dict[int, tuple[Curve, float, Sums]] = {}
        """The curves that were asked for last, their distances from those, and the results."""

    def keep(self, block: int, curve: Curve, sums: Sums) -> None:
        """Keep the sums of a block along a curve, in place of earlier ones."""
        self._sums[block] = curve, sums
        self._latest[block] = curve, 0.0, sums

    def seen_along(self, block: int, curve: Curve, max_distance: float) -> Sums | None:
        """Return the kept sums of a block with the remainders of another curve.

        Return None if they were counted more than a distance in pixels away from this curve.
        """
        if block not in self._sums:
            return None
        latest, distance, sums = self._latest[block]
        if np.array_equal(latest.fields, curve.fields):
            return sums if distance <= max_distance else None
        counted, sums = self._sums[block]
        distance = counted.distance(curve)
        if not distance <= max_distance:
            return None  # also if displacements are NaN
        if distance > 0:
            sums = sums.seen_along(curve.mean - counted.mean)
        self._latest[block] = curve, distance, sums
        return sums


def keeps_sums(size: tuple[int, int], blocks: int, *, jots_differ: bool = False) -> bool:
    """Return whether the sums of all blocks of an image of H x W pixels are kept."""
    of_pixel = _BYTES_OF_SUMS + (_BYTES_OF_JOTS if jots_differ else 0)
    return size[0] * size[1] * of_pixel * blocks <= _MAX_KEPT_BYTES


@functools.lru_cache(maxsize=256)
def _weights(frames: Sequence[float], times: tuple[float, ...]) -> Array:
    """Return the weights in each frame, (n, m), of fields at some times.

    Every change of a motion needs them again, so they are kept.
    """
    index, place = locate(np.array(frames, np.float64), times)
    weights = np.zeros((len(index), len(times)))
    weights[np.arange(len(index)), index] = 1 - place
    weights[np.arange(len(index)), index + 1] = place
    return weights


@functools.lru_cache(maxsize=256)
def _mean_weights(frames: Sequence[float], times: tuple[float, ...]) -> Array:
    """Return the mean weights of the frames, (m,)."""
    return np.asarray(_weights(frames, times).mean(axis=0))
