"""Tiles that move by themselves, where segments do not explain a scene."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Blocks
from jotlight.motion.consistency import Consistent, disagreement, find_consistent
from jotlight.motion.deformation import BENT, STRONGLY_BENT, follow_tiles
from jotlight.motion.flags import find_flags
from jotlight.motion.flicker import without_saturation
from jotlight.motion.outlines import choose
from jotlight.motion.selection import likelihood_gain
from jotlight.motion.tiles import mean_tiles
from jotlight.motion.track import Paths, Track

Array = npt.NDArray[np.float64]

_MIN_ACCEPTED = 0.6
"""Fraction of the bits of a pixel that must agree with the rest, for its motion to be known."""

_MAX_UNKNOWN = 0.02
"""Fraction of pixels with unknown motion above which tiles are tried."""

_MAX_FLAGGED, _MAX_FLAGGED_OUTLINES = 0.15, 0.4
"""Fractions of flagged pixels above which tiles are tried: without outlines, and with outlines.

Pixels near outlines are always flagged.
"""

_NATS_OF_TILE = 0.03
"""Nats that each displacement of a tile in each block must gain.

In simulations, tiles that improved the image gained 0.039 or more, and those that did harm 0.017.
"""

_MAX_LOSS = 0.005
"""Tiles must not reject this fraction of the bits more. They might fit some parts too closely."""


def share_of_unknown(consistent: Consistent) -> float:
    """Return the fraction of pixels of which many bits disagree with the rest.

    Pixels without bits, such as those of dead jots, do not count.
    """
    unknown = consistent.accepted[consistent.total.trials > 0] < _MIN_ACCEPTED
    return float(unknown.sum() / max(unknown.size, 1))


def is_unexplained(paths: Paths, consistent: Consistent) -> bool:
    """Return whether so many bits disagree that tiles may explain the scene better."""
    if share_of_unknown(consistent) > _MAX_UNKNOWN:
        return True
    threads = paths.blocks.threads
    halves = without_saturation(consistent.before, consistent.after, threads)
    flags = find_flags(consistent, disagreement(*halves, threads), paths.labels)
    limit = _MAX_FLAGGED if len(paths.tracks) == 1 else _MAX_FLAGGED_OUTLINES
    return bool(flags.mean() > limit)


def add_tiles(
    blocks: Blocks, reference: int, paths: Paths, consistent: Consistent | None
) -> tuple[Paths, Consistent | None]:
    """Return paths with a track whose tiles move by themselves, and the sums along them.

    Of two fields that bend more or less, the one that explains the bits better is taken. The given
    paths are returned if no pixel follows the tiles, if they explain the bits better, or if clearly
    fewer bits agree with the tiles.
    """
    velocity = _velocity(paths)
    best, most = paths, likelihood_gain(paths) if consistent else -np.inf
    for smoothness in (BENT, STRONGLY_BENT):
        tiles = follow_tiles(blocks, reference, velocity, smoothness)
        more = _with_track(paths, tiles)
        if more is not paths and (gain := likelihood_gain(more) - _cost_of_tiles(more)) > most:
            best, most = more, gain
    if best is paths or consistent is None:
        return best, consistent
    others = find_consistent(best.with_all_frames())
    if others.accepted.mean() < consistent.accepted.mean() - _MAX_LOSS:
        return paths, consistent
    return best, others


def _with_track(paths: Paths, tiles: Track) -> Paths:
    """Return paths whose pixels follow a further track where it is better, if there are any."""
    tracks = [*paths.tracks, tiles]
    is_free = choose(tracks) == len(paths.tracks)
    if not is_free.any():
        return paths
    labels = np.where(is_free, np.uint8(len(paths.tracks)), paths.labels)
    return Paths(tracks, labels, free=1)


def _cost_of_tiles(paths: Paths) -> float:
    """Return what the displacements of tiles that pixels follow gain by chance, in nats."""
    share = (paths.labels == len(paths.tracks) - 1).mean() if paths.free else 0.0
    return float(_NATS_OF_TILE * paths.tracks[-1].nodes.size * share)


def _velocity(paths: Paths) -> Array:
    """Return the velocity of each tile: that of the track of most of its pixels."""
    shares = [
        mean_tiles((paths.labels == index).astype(np.float32)) for index in range(len(paths.tracks))
    ]
    largest = np.argmax(shares, axis=0)
    return np.asarray(np.choose(largest, [track.velocity() for track in paths.tracks]))
