"""Tiles that move by themselves, where segments do not explain a scene."""

import numpy as np

from jotlight.array_types import Array
from jotlight.motion.agreement.consistency import MIN_ACCEPTED, Consistent, find_consistent
from jotlight.motion.agreement.expected_errors import is_displaced, may_hide_displacements
from jotlight.motion.agreement.flags import find_flags
from jotlight.motion.displacements.deformation import follow_tiles
from jotlight.motion.displacements.disagreement import disagreement
from jotlight.motion.displacements.flicker import without_saturation
from jotlight.motion.displacements.scoring import make_template
from jotlight.motion.displacements.tile_updates import improve_tiles_together
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.labels import choose
from jotlight.motion.outlines.likelihood_gain import likelihood_gain
from jotlight.motion.outlines.outlines import choose_labels
from jotlight.motion.tiles import mean_tiles

_MAX_UNKNOWN = 0.02
"""Fraction of pixels with unknown motion above which tiles are tried."""

_MAX_FLAGGED, _MAX_FLAGGED_OUTLINES = 0.15, 0.4
"""Fractions of flagged pixels above which tiles are tried: without outlines, and with outlines.

Pixels near outlines are always flagged.
"""

_MIN_MOTION = 1.0
"""Displacement in pixels below which flags are no reason to try tiles.

In scenes that stand still, fine patterns are flagged, and tiles may gain by blurring them.
"""

_MIN_GAIN = 2.0
"""Nats that tiles must gain for each of their degrees of freedom.

In simulations, tiles with more exact displacements gained 3.2 or more, and others at most 1.2.
"""

_MIN_PART = 0.02
"""Gain of the tiles, relative to that of the other motion, below which they hardly change it."""

_MIN_SHARE = 0.1
"""Fraction of the pixels that must follow tiles. Smaller regions are objects, which may appear."""


def share_of_unknown(consistent: Consistent) -> float:
    """Return the fraction of pixels of which many bits disagree with the rest.

    Pixels without bits, such as those of dead jots, do not count.
    """
    unknown = consistent.accepted[consistent.total.trials > 0] < MIN_ACCEPTED
    return float(unknown.sum() / max(unknown.size, 1))


def is_unexplained(paths: Paths, consistent: Consistent) -> bool:
    """Return whether enough bits disagree for tiles to be tried."""
    if share_of_unknown(consistent) > _MAX_UNKNOWN:
        return True
    if max(abs(track.nodes).max() for track in paths.tracks) < _MIN_MOTION:
        return False
    threads = paths.blocks.threads
    may_hide = len(paths.tracks) == 1 and may_hide_displacements(consistent)
    if may_hide and is_displaced(consistent, make_template(consistent.total, threads)):
        # In dim light, the bits of pixels agree with a wrong motion, too.
        return True
    halves = without_saturation(consistent.before, consistent.after, threads, consistent.lights)
    flags = find_flags(consistent, disagreement(*halves, threads), paths.labels)
    limit = _MAX_FLAGGED if len(paths.tracks) == 1 else _MAX_FLAGGED_OUTLINES
    return bool(flags.mean() > limit)


def add_tiles(paths: Paths, consistent: Consistent | None) -> tuple[Paths, Consistent | None]:
    """Return paths with a track whose tiles move by themselves, and the sums along them.

    The tiles deviate from the motions of most of their pixels, or from that of most of all pixels.
    The given paths are returned if they explain the bits better, or if fewer bits agree with the
    tiles.
    """
    best, most = paths, -np.inf
    if consistent is not None:
        gain = likelihood_gain(paths)
        most = gain + _MIN_PART * max(gain, 0.0)
    for start in _starts(paths):
        tiles = follow_tiles(paths.blocks, start)
        for more in _with_track(paths, tiles):
            gain = likelihood_gain(more) - needed_by_tiles(more)
            if gain > most:
                best, most = more, gain
    if best is paths:
        return paths, consistent
    # Neighboring tiles may belong to different objects.
    improve_tiles_together(best.tracks[-1])
    if consistent is None:
        return best, None
    others = find_consistent(best.exact())
    if others.accepted.mean() < consistent.accepted.mean():
        # They explain something else than a motion, such as an object that appears.
        return paths, consistent
    return best, others


def needed_by_tiles(paths: Paths) -> float:
    """Return how many nats paths must gain for the degrees of freedom of their tiles."""
    free = range(len(paths.tracks) - paths.free, len(paths.tracks))
    shares = [float((paths.labels == index).mean()) * paths.tracks[index].freedom for index in free]
    return _MIN_GAIN * sum(shares)


def _with_track(paths: Paths, tiles: Track) -> list[Paths]:
    """Return paths whose pixels follow a further track: where it is better, and everywhere.

    In dim light, the bits of a pixel and its neighbors do not show which track is better.
    """
    tracks, index = [*paths.tracks, tiles], np.uint8(len(paths.tracks))
    is_free = choose_labels(tracks) == index
    masks = [np.ones_like(is_free)]
    if _MIN_SHARE <= is_free.mean() < 1:
        masks.append(is_free)
    return [Paths(tracks, np.where(mask, index, paths.labels), free=1) for mask in masks]


def _starts(paths: Paths) -> list[Array]:
    """Return the displacements of all blocks from which tiles may deviate.

    These are those of the track of most pixels of each tile, and those of the largest track. Where
    a scene deforms, segments are parts of the deformation.
    """
    nodes = [track.nodes for track in paths.tracks]
    if len(nodes) == 1:
        return nodes
    shares = np.stack(
        [mean_tiles((paths.labels == index).astype(np.float32)) for index in range(len(nodes))]
    )
    largest = int(shares.sum(axis=(1, 2)).argmax())
    return [choose(shares.argmax(axis=0), nodes), nodes[largest]]
