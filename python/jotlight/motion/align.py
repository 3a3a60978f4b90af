"""The motion of a scene, estimated from its bits."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.affine import follow, improve_together
from jotlight.motion.blocks import Blocks
from jotlight.motion.consistency import merge_consistent
from jotlight.motion.deformation import follow_tiles
from jotlight.motion.outlines import choose
from jotlight.motion.segments import Segment, find_segments
from jotlight.motion.selection import likelihood_gain
from jotlight.motion.tiles import mean_tiles, tile_counts
from jotlight.motion.track import Paths, Track

Array = npt.NDArray[np.float64]

_ROUNDS = 2
"""Number of rounds that improve the motions of segments after their outlines are known."""

_MIN_FRACTION = 0.5
"""Minimum fraction of a tile that a segment covers, for the tile to improve its motion."""

_PARAMETERS = 6
"""Number of parameters of an affine motion of each block. A motion must gain as many nats."""

_MIN_ACCEPTED = 0.6
"""Fraction of the bits of a pixel that must agree with the rest, for its motion to be known."""

_MAX_UNKNOWN = 0.02
"""Fraction of pixels with unknown motion above which each tile gets its own motion."""


def divide(frames: int) -> npt.NDArray[np.intp]:
    """Return the first frame of each block, and the number of frames.

    There are T/8 blocks, but at least 16 and at most 32.
    """
    number = int(np.clip(frames / 8, 16, 32))
    return np.round(np.linspace(0, frames, number + 1)).astype(np.intp)


def find_paths(blocks: Blocks, reference: int) -> Paths:
    """Return the paths of all pixels under the motion that explains the bits best."""
    segments = find_segments(blocks, reference)
    tracks = [follow(blocks, reference, segment) for segment in segments]
    paths = Paths(tracks, choose(tracks))
    if len(tracks) > 1:
        paths = _improve_segments(paths)
    _, accepted = merge_consistent(paths)
    if (accepted < _MIN_ACCEPTED).mean() > _MAX_UNKNOWN:
        tracks.append(follow_tiles(blocks, reference, _velocity(paths, segments)))
        paths = Paths(tracks, choose(tracks))
    still = Paths([_still(blocks, reference)], np.zeros(blocks.size, np.uint8))
    if likelihood_gain(paths, still) > _PARAMETERS * len(blocks.centers):
        return paths
    return still


def _improve_segments(paths: Paths) -> Paths:
    """Return paths with better motions, from tiles inside the outlines of each segment."""
    for index, track in enumerate(paths.tracks):
        fraction = mean_tiles((paths.labels == index).astype(np.float32))
        weights = np.where(fraction >= _MIN_FRACTION, fraction, 0)
        if weights.any():
            for _ in range(_ROUNDS):
                improve_together(track, weights)
    return Paths(paths.tracks, choose(paths.tracks))


def _velocity(paths: Paths, segments: list[Segment]) -> Array:
    """Return the velocity of each tile: that of the segment of most of its pixels."""
    shares = [
        mean_tiles((paths.labels == index).astype(np.float32)) for index in range(len(segments))
    ]
    largest = np.argmax(shares, axis=0)
    return np.choose(largest, [segment.velocity for segment in segments])


def _still(blocks: Blocks, reference: int) -> Track:
    """Return the track of a scene that stands still."""
    shape, number = tile_counts(blocks.size), len(blocks.centers)
    return Track(
        blocks,
        reference,
        np.zeros((number, 2, *shape)),
        np.ones(number, bool),
        np.zeros((number, 3, *shape)),
    )
