"""Paths of several segments: their motions, and the outlines between them."""

import numpy as np

from jotlight.motion.displacements.affine import improve_inside, improve_together
from jotlight.motion.displacements.track import Paths
from jotlight.motion.outlines.depth import order_by_depth, refine_outlines, without_absent
from jotlight.motion.outlines.likelihood_gain import likelihood_gain
from jotlight.motion.outlines.objects import more_likely
from jotlight.motion.outlines.outlines import choose_labels
from jotlight.motion.tiles import mean_tiles

ROUNDS = 2
"""Number of rounds that improve the motions of segments with the tiles that they cover."""

_SHORT = 24.0
"""Distance in pixels by which two tracks move apart, below which their outlines are in doubt.

If they move less, smooth regions may belong to either, and either may be in front.
"""

_MIN_LARGE = 0.05
"""Fraction of the pixels above which a segment is large. The outlines of small ones are clear."""

_MIN_FRACTION = 0.5
"""Minimum fraction of a tile that a segment covers, for the tile to improve its motion."""


def add_outlines(paths: Paths) -> Paths:
    """Return paths of several tracks with better motions and outlines, or of the first one alone.

    The first one is at the back.
    """
    paths = _from_back_to_front(_improve_segments(paths))
    paths = without_absent(refine_outlines(improve_inside(refine_outlines(paths))))
    if len(paths.tracks) == 2 and _are_in_doubt(paths):
        paths = _with_other_outlines(paths)
    alone = Paths(paths.tracks[:1], np.zeros_like(paths.labels))
    return more_likely(alone, paths)


def _improve_segments(paths: Paths) -> Paths:
    """Return paths with better motions, from tiles inside the outlines of each segment."""
    for index, track in enumerate(paths.tracks):
        fraction = mean_tiles((paths.labels == index).astype(np.float32))
        weights = np.where(fraction >= _MIN_FRACTION, fraction, 0)
        if weights.any():
            for _ in range(ROUNDS):
                improve_together(track, weights)
    return Paths(paths.tracks, choose_labels(paths.tracks))


def _are_in_doubt(paths: Paths) -> bool:
    """Return whether the outlines of two large segments are in doubt, because they hardly part."""
    first, second = paths.tracks
    apart = (first.nodes - second.nodes).mean(axis=(2, 3))
    share = np.bincount(paths.labels.ravel(), minlength=2).min() / paths.labels.size
    return bool(np.hypot(*np.ptp(apart, axis=0)) < _SHORT and share > _MIN_LARGE)


def _with_other_outlines(paths: Paths) -> Paths:
    """Return two tracks with other outlines, if these explain the bits better.

    They are found from an object that has no pixels at first, so that its background is known
    everywhere, and with either track in front.
    """
    most, empty = likelihood_gain(paths), np.zeros_like(paths.labels)
    for tracks in (paths.tracks, paths.tracks[::-1]):
        other = refine_outlines(improve_inside(refine_outlines(Paths(list(tracks), empty))))
        gain = likelihood_gain(other)
        if gain > most:
            paths, most = other, gain
    return paths


def _from_back_to_front(paths: Paths) -> Paths:
    """Return paths whose tracks are in their order from back to front."""
    order = order_by_depth(np.bincount(paths.labels.ravel(), minlength=len(paths.tracks)))
    labels = np.argsort(order).astype(np.uint8)[paths.labels]
    return Paths([paths.tracks[index] for index in order], labels)
