"""Tiles that move by themselves, where segments do not explain a scene."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.consistency import Consistent, find_consistent
from jotlight.motion.deformation import LESS_SMOOTH, SMOOTH, follow_tiles
from jotlight.motion.disagreement import disagreement
from jotlight.motion.flags import find_flags
from jotlight.motion.flicker import without_saturation
from jotlight.motion.likelihood_gain import likelihood_gain
from jotlight.motion.outlines import choose_labels
from jotlight.motion.regularize import Smoothness
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

_MIN_MOTION = 1.0
"""Displacement in pixels below which flags are no reason to try tiles.

In scenes that stand still, fine patterns are flagged, and tiles may gain by blurring them.
"""

_MIN_GAIN = 2.0
"""Nats that tiles must gain for each of their degrees of freedom.

In simulations, tiles with more exact displacements gained 3.2 or more, and others at most 1.2.
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
    """Return whether enough bits disagree for tiles to be tried."""
    if share_of_unknown(consistent) > _MAX_UNKNOWN:
        return True
    if max(abs(track.nodes).max() for track in paths.tracks) < _MIN_MOTION:
        return False
    threads = paths.blocks.threads
    halves = without_saturation(consistent.before, consistent.after, threads, consistent.lights)
    flags = find_flags(consistent, disagreement(*halves, threads), paths.labels)
    limit = _MAX_FLAGGED if len(paths.tracks) == 1 else _MAX_FLAGGED_OUTLINES
    return bool(flags.mean() > limit)


def add_tiles(paths: Paths, consistent: Consistent | None) -> tuple[Paths, Consistent | None]:
    """Return paths with a track whose tiles move by themselves, and the sums along them.

    Of two fields of different smoothness, the one that explains the bits better is taken. The given
    paths are returned if no pixel follows the tiles, if they explain the bits better, or if clearly
    fewer bits agree with the tiles.
    """
    velocity = _velocity(paths)
    best, most = paths, likelihood_gain(paths) if consistent else -np.inf
    for smoothness in (SMOOTH, LESS_SMOOTH):
        tiles = follow_tiles(paths.blocks, velocity, smoothness)
        more = _with_track(paths, tiles)
        if more is not paths:
            share = float((more.labels == len(paths.tracks)).mean())
            needed = _MIN_GAIN * share * degrees_of_freedom(tiles.information, smoothness)
            if (gain := likelihood_gain(more) - needed) > most:
                best, most = more, gain
    if best is paths or consistent is None:
        return best, consistent
    others = find_consistent(best.exact())
    if others.accepted.mean() < consistent.accepted.mean() - _MAX_LOSS:
        return paths, consistent
    return best, others


def _with_track(paths: Paths, tiles: Track) -> Paths:
    """Return paths whose pixels follow a further track where it is better, if there are any."""
    tracks = [*paths.tracks, tiles]
    is_free = choose_labels(tracks) == len(paths.tracks)
    if not is_free.any():
        return paths
    labels = np.where(is_free, np.uint8(len(paths.tracks)), paths.labels)
    return Paths(tracks, labels, free=1)


def degrees_of_freedom(information: Array, smoothness: Smoothness) -> float:
    """Return how many displacements of tiles the bits determine, rather than their neighbors.

    It is the trace of A (A + λ)⁻¹ of all tiles, with the information A of a tile, and the weight λ
    with which its four neighbors draw it toward an affine field.

    Parameters
    ----------
    information : ndarray of float, shape (n, 3, rows, columns)
        The entries of A for rows, for rows and columns, and for columns, in nats/px².
    smoothness : Smoothness
        How similar the displacements of neighboring tiles are.

    Examples
    --------
    >>> round(degrees_of_freedom(np.array([1e9, 0.0, 4.0]).reshape(1, 3, 1, 1), SMOOTH), 3)
    1.333
    """
    weight = 4 * smoothness.to_affine
    rows, columns = information[:, 0] + weight, information[:, 2] + weight
    determinant = rows * columns - information[:, 1] ** 2
    return float((2 - weight * (rows + columns) / determinant).sum())


def _velocity(paths: Paths) -> Array:
    """Return the velocity of each tile: that of the track of most of its pixels."""
    shares = [
        mean_tiles((paths.labels == index).astype(np.float32)) for index in range(len(paths.tracks))
    ]
    largest = np.argmax(shares, axis=0)
    return np.asarray(np.choose(largest, [track.velocity() for track in paths.tracks]))
