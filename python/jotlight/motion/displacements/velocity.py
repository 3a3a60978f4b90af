"""Velocities in a scene, from the correlations of short blocks of frames.

Two blocks of dim frames hardly correlate. But the correlations of all pairs of blocks together show
a velocity, as :mod:`jotlight.motion.displacements.velocity_scores` describes.
"""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array, Counts
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.equivalent import flatten_counts
from jotlight.motion.counts.jots import Jots
from jotlight.motion.displacements.rotation import find_rotation
from jotlight.motion.displacements.velocity_scores import BIN, MAX_BLOCKS, MIN_PEAK, VelocityScores
from jotlight.motion.tiles import tile_centers

_SHORT = 8
"""Longer blocks are shortened to a quarter, and others to a half."""

_LAGS = (1, 2, 3, 4, 6, 8, 12, 16)
"""Distances in blocks of the pairs that are correlated."""

_STRIDE = 64 // BIN
"""Maximum distance of neighboring windows, in bins."""

_MAX_PEAKS = 3
"""Maximum number of velocities for each length of the blocks."""

_EXPLAINED = 0.7
"""A velocity explains a window if it has this fraction of the window's best score."""


def find_velocities(blocks: Blocks) -> Array:
    """Return the velocities in the middle of a burst, (n, 2, rows, columns), in pixels per frame.

    They are fields of the velocities of tiles. The first one is 0. Others are constant, or a
    rotation with a zoom. Long blocks show slow motions best, and short ones fast motions.

    Parameters
    ----------
    blocks : Blocks
        The burst. Blocks of other lengths are correlated.
    """
    size, threads, pattern = blocks.size, blocks.threads, blocks.pattern
    places = tile_centers(size) - (np.array(size).reshape(2, 1, 1) - 1) / 2
    found = [np.zeros_like(places)]
    for length in _lengths(blocks.half):
        counts = _count_blocks(blocks, length, pattern)
        frames = length * len(counts)
        for velocity, matrix in _peaks(counts, length, threads):
            field = velocity[:, None, None] + np.tensordot(matrix, places, axes=1)
            difference = np.hypot(*np.moveaxis(np.stack(found) - field, 1, 0)).max(axis=(1, 2))
            if (difference * frames > 2).all():
                found.append(field)
    return np.stack(found)


def _lengths(available: int) -> list[int]:
    """Return the lengths of blocks that are correlated, with a number of frames on each side.

    Examples
    --------
    >>> [_lengths(available) for available in (0, 10, 500)]
    [[], [1], [31, 7, 3, 1]]
    """
    lengths = []
    length = max(1, 2 * available // MAX_BLOCKS) if available > 0 else 0
    while length > 0:
        lengths.append(length)
        length = length // 4 if length > _SHORT else length // 2
    return lengths


def _count_blocks(blocks: Blocks, length: int, jots: Jots | None = None) -> Counts:
    """Return the counts of parts around the middle frame, in squares of pixels, (n, h, w).

    The rest at the right and at the bottom is left out. The pattern of `jots`, which stands still,
    is left out, too.
    """
    burst, threads = blocks.burst, blocks.threads
    number = min(MAX_BLOCKS, 2 * (blocks.half // length))
    start = blocks.middle - number // 2 * length
    side = BIN if min(burst.size) > BIN else 1
    height, width = burst.size[0] // side, burst.size[1] // side
    counts = np.zeros((number, height, width), np.int32)
    row = slice(0, height * side), slice(0, -(-width * side // 8))
    valid = None if jots is None else np.packbits(jots.maps[2, *row[:1]] > 0, axis=1)[:, row[1]]
    for part, planes in burst.parts(range(start, start + number * length)):
        for weight, packed in planes:
            before = part.start - start
            block = before // length
            engine.add_counts_of_blocks(
                packed[:, *row] if valid is None else packed[:, *row] & valid,
                width * side,
                side,
                before % length,
                length,
                weight,
                counts[block:],
                threads,
            )
    if jots is None:
        return counts
    starts = range(start, start + number * length, length)
    lit = [burst.number_lit(range(first, first + length)) for first in starts]
    return flatten_counts(counts, burst.trials * np.array(lit), side, jots)


def _peaks(blocks: Counts, length: int, threads: int | None) -> Iterator[tuple[Array, Array]]:
    """Yield the best velocities, each with the matrix by which it changes per pixel.

    The first one is that of the whole image, and the second is a rotation. The third is the best
    one of all windows together. The others are the best ones of windows that the third one and
    those after it do not explain.
    """
    constant = np.zeros((2, 2))
    if len(blocks) < 2:
        return
    found = VelocityScores(blocks, length, _LAGS, threads)
    line = found.line
    if (velocity := _best(found.of_whole_image(), line)) is not None:
        yield velocity, constant
    scores, centers = found.of_windows(_STRIDE)
    if (rotation := find_rotation(scores, centers, line, threads)) is not None:
        yield rotation
    active = np.ones(len(scores), bool)
    best = scores.reshape(len(scores), -1).max(axis=1)
    for _ in range(_MAX_PEAKS):
        total = scores[active].sum(axis=0)
        if (velocity := _best(total, line)) is not None:
            yield velocity, constant
        row, column = np.unravel_index(int(np.argmax(total)), total.shape)
        active &= scores[:, row, column] < _EXPLAINED * best
        if not active.any():
            return


def _best(scores: npt.NDArray[np.float32], line: Array) -> Array | None:
    """Return the velocity with the best score, or None if it is not a clear peak."""
    row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
    last = len(line) - 1
    is_clear = scores[row, column] - scores.mean() >= MIN_PEAK * scores.std()
    if not is_clear or row in (0, last) or column in (0, last):
        return None
    return np.array([line[row], line[column]])
