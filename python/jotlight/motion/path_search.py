"""The search for the paths of all pixels that explain the bits of a scene best."""

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np

from jotlight.array_types import Array
from jotlight.motion.agreement.consistency import CLEARLY_MORE, Consistent, find_consistent
from jotlight.motion.agreement.held_out import central_frames, held_out_likelihood
from jotlight.motion.agreement.stricter_test import select_bits
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.kept_sums import keeps_sums
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.affine import follow_segment, follow_together, improve_together
from jotlight.motion.displacements.scoring import make_blurred_template
from jotlight.motion.displacements.segments import Segment, energy_of, find_segments
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.outlines.added_tiles import (
    add_tiles,
    is_unexplained,
    needed_by_tiles,
    share_of_unknown,
)
from jotlight.motion.outlines.likelihood_gain import likelihood_gain
from jotlight.motion.outlines.objects import MAX_OBJECTS, PARAMETERS, add_objects
from jotlight.motion.outlines.outlines import choose_labels
from jotlight.motion.outlines.segment_outlines import ROUNDS, add_outlines

_EXPLAINED = 0.8
"""A track explains a segment if it has at least this fraction of the energy at its velocity."""

_CLEAR = 10.0
"""A motion is clearly right if its gain with blurred templates exceeds this multiple of the gain
that it needs."""

_MOVES = 1.0
"""Smallest displacement in pixels, within the burst, of a scene that moves at a velocity."""

_OBJECTS_UNKNOWN = 0.002, 0.15
"""Fractions of pixels with unknown motion between which further objects are searched.

If more is unknown, objects that keep their shape hardly explain it, and the search takes long.
"""

_MUCH_UNKNOWN = 0.08
"""Fraction of pixels with unknown motion above which objects must explain much of them."""

_UNCLEAR = 0.04
"""Fraction of pixels with unknown motion from which on parts may be wrong."""

_MUST_EXPLAIN = (1, 0.3), (MAX_OBJECTS - 1, 0.5)
"""Pairs: how many objects are added then, and which fraction of the unknown pixels all objects must
explain afterward."""


@dataclasses.dataclass(frozen=True)
class Found:
    """The paths that explain the bits best."""

    paths: Paths
    model: str
    """One of MODELS."""
    consistent: Consistent | None
    """The sums along the paths, if they were computed."""
    is_explained: bool = True
    """Whether few bits disagreed with the segments, so that tiles were not tried."""


def find_paths(blocks: Blocks, model: str, advance: Callable[[float], object]) -> Found:
    """Return the paths of all pixels under a model of their motion.

    Parameters
    ----------
    blocks : Blocks
        The burst.
    model : str
        One of MODELS, or "auto" for the one that explains the bits best.
    advance : callable
        A function that is called repeatedly with the completed fraction, from 0 to 1.
    """
    if not keeps_sums(blocks.size, len(blocks.centers), jots_differ=blocks.jots is not None):
        # All frames of such long bursts are counted only when the paths are known.
        blocks = blocks.with_enough_light()
    still = Paths([Track.still(blocks)], np.zeros(blocks.size, np.uint8))
    advance(0.0)
    if model == "none":
        advance(1.0)
        return Found(still.exact(), model, None)
    divisions = find_segments(blocks)
    advance(0.2)
    if model == "auto":
        best = _best_of(blocks, divisions, Found(still, "none", None), advance)
    else:
        best = _explain(blocks, divisions[0], model, advance)
    advance(1.0)
    return dataclasses.replace(best, paths=best.paths.exact())


def _best_of(
    blocks: Blocks,
    divisions: list[list[Segment]],
    still: Found,
    advance: Callable[[float], object],
) -> Found:
    """Return the paths that explain the scene best: without motion, or by one of its divisions."""
    best, most = still, 0.0
    for number, segments in enumerate(divisions):
        found = _explain(blocks, segments, "auto", advance if number == 0 else _ignore)
        gain, is_clear = _gain_over_rest(found.paths)
        if gain > most:
            best, most = found, gain
        if is_clear:
            break
    else:
        best = _or_constant_velocity(blocks, divisions, best, most)
    if len(best.paths.tracks) - best.paths.free == 1 and not best.is_explained:
        best = _slow_segments(blocks, best)
    return _without_wrong_parts(best, still)


def _or_constant_velocity(
    blocks: Blocks, divisions: list[list[Segment]], best: Found, most: float
) -> Found:
    """Return the path of a scene that begins at a constant velocity, or a better one.

    In dim light, such as that of a few stars, blocks that are aligned one after the other get lost.
    The velocities of all segments are tried, because rotations that do not occur may come first.
    `most` is the gain of the best paths found so far.
    """
    found: Paths | None = None
    tried: list[Array] = []
    for segment in itertools.chain.from_iterable(divisions):
        displacements = segment.velocity * len(blocks.burst)
        others = (abs(displacements - each).max() for each in tried)
        if np.hypot(*displacements).max() < _MOVES or any(each < _MOVES for each in others):
            continue
        tried.append(displacements)
        paths = Paths([follow_together(blocks, segment)], np.zeros(blocks.size, np.uint8))
        gain = _gain_over_rest(paths)[0]
        if gain > most:
            found, most = paths, gain
    return best if found is None else Found(found, "affine", find_consistent(found.exact()))


def _without_wrong_parts(found: Found, still: Found) -> Found:
    """Return paths, or only those of the background if parts with other motions may be wrong.

    Where much is still unknown, such as people who deform, bits agree with parts, and are more
    likely with them, although the image is worse. Frames in the middle that are held out show this.
    The background may stand still.
    """
    paths, consistent = found.paths, found.consistent
    if len(paths.tracks) == 1 or consistent is None or share_of_unknown(consistent) < _UNCLEAR:
        return found
    alone = Paths(paths.tracks[:1], np.zeros_like(paths.labels))
    other = find_consistent(alone.exact())
    held = central_frames(paths, consistent.total)
    if _held_out(paths, consistent, held) >= _held_out(alone, other, held):
        return found
    if _gain_over_rest(alone)[0] <= 0:
        return still
    return Found(alone, "affine", other, found.is_explained)


def _held_out(paths: Paths, consistent: Consistent, held: range) -> float:
    """Return the log-likelihood of frames that are held out."""
    paths = paths.exact()
    return held_out_likelihood(paths, select_bits(paths, consistent).total, held)


def _slow_segments(blocks: Blocks, found: Found) -> Found:
    """Return paths of segments that move slowly if they explain the scene better, or those found.

    If parts of a scene move slowly, they disagree with a single segment before their velocities
    differ clearly. So the paths found before have one segment, and perhaps tiles.
    """
    for segments in find_segments(blocks, is_slow=True):
        if len(segments) > 1:
            other = _explain(blocks, segments, "auto", _ignore)
            if other.model == "segments" and _explains_more(other, found):
                found = other
    return found


def _explains_more(found: Found, other: Found) -> bool:
    """Return whether paths explain the bits better than others.

    They do if clearly more bits agree with them. If about as many agree, likelihoods decide.
    """
    more = _share_of_agreeing(found) - _share_of_agreeing(other)
    if abs(more) > CLEARLY_MORE:
        return more > 0
    return _net_gain(found.paths) > _net_gain(other.paths)


def _share_of_agreeing(found: Found) -> float:
    """Return the fraction of the bits that agree with the paths."""
    assert found.consistent is not None, "the sums along paths of the model auto"
    return float(found.consistent.accepted.mean())


def _net_gain(paths: Paths) -> float:
    """Return the gain of the log-likelihood in nats, without what is needed for the parameters."""
    segments = len(paths.tracks) - paths.free
    parameters = PARAMETERS * len(paths.blocks.centers) * (segments - 1)
    return likelihood_gain(paths) - parameters - needed_by_tiles(paths)


def _ignore(_: float) -> None:
    """Ignore the progress."""


def _explain(
    blocks: Blocks,
    segments: list[Segment],
    model: str,
    advance: Callable[[float], object],
) -> Found:
    """Return the paths of all pixels, if the scene is divided into segments."""
    if model == "affine":
        weights = np.ones_like(segments[0].weights)
        segments = [dataclasses.replace(segments[0], weights=weights)]
    tracks = _follow(blocks, segments)
    advance(0.6)
    paths = Paths(tracks, choose_labels(tracks))
    if len(tracks) > 1:
        paths = add_outlines(paths)
    advance(0.7)
    consistent = None
    if model == "auto":
        paths, consistent = _with_objects(paths)
    is_explained = consistent is None or not is_unexplained(paths, consistent)
    if model == "tiles" or not is_explained:
        paths, consistent = add_tiles(paths, consistent)
    advance(0.9)
    is_single = len(np.unique(paths.labels)) == 1
    name = "tiles" if paths.free else "affine" if is_single else "segments"
    return Found(paths, name, consistent, is_explained)


def _follow(blocks: Blocks, segments: list[Segment]) -> list[Track]:
    """Return the tracks of the segments that move differently.

    The velocity of a scene changes with time. So a segment may have another constant velocity than
    the first one, but the same motion.
    """
    tracks = [follow_segment(blocks, segments[0])]
    for segment in segments[1:]:
        tiles = segment.weights > 0
        others = [float(_energy_along(track, segment.half)[tiles].sum()) for track in tracks]
        if max(others) < _EXPLAINED * segment.energy:
            tracks.append(follow_segment(blocks, segment))
    if len(tracks) == 1 and len(segments) > 1:
        for _ in range(ROUNDS):
            improve_together(tracks[0], np.ones_like(segments[0].weights))
    return tracks


def _energy_along(track: Track, half: int) -> Array:
    """Return the energy along a track of the frames that are up to `half` frames away."""
    central = np.flatnonzero(abs(track.blocks.centers - track.reference) < half)
    threads = track.blocks.threads
    sums = Sums.total((track.sums(int(block)) for block in central), threads)
    return energy_of(sums, threads)


def _gain_over_rest(paths: Paths) -> tuple[float, bool]:
    """Return by how much paths explain the bits better than no motion, and whether it is clear.

    The gain is that of the log-likelihood in nats, without what its parameters gain by chance.
    """
    needed = PARAMETERS * len(paths.blocks.centers) * len(np.unique(paths.labels))
    gain = likelihood_gain(paths, make_blurred_template)
    if gain > _CLEAR * needed:
        return gain - needed, True
    return likelihood_gain(paths) - needed, False


def _with_objects(paths: Paths) -> tuple[Paths, Consistent]:
    """Return paths with tracks of objects that nothing explains yet, and the sums along them.

    The given paths are returned if no object is found.
    """
    consistent = find_consistent(paths.exact())
    unknown = share_of_unknown(consistent)
    if not _OBJECTS_UNKNOWN[0] < unknown < _OBJECTS_UNKNOWN[1]:
        return paths, consistent
    if unknown > _MUCH_UNKNOWN:
        return _with_large_objects(paths, consistent)
    more = add_objects(paths)
    return (paths, consistent) if more is paths else (more, find_consistent(more.exact()))


def _with_large_objects(paths: Paths, consistent: Consistent) -> tuple[Paths, Consistent]:
    """Return paths with tracks of objects that explain much of what is unknown, and the sums.

    Otherwise, return the given paths. The parts of such a scene deform, and what looks like an
    object is a region whose motion is alike for a short time.
    """
    unknown, more, along = share_of_unknown(consistent), paths, consistent
    for most, share in _MUST_EXPLAIN:
        before, more = more, add_objects(more, most)
        along = along if more is before else find_consistent(more.exact())
        if share_of_unknown(along) > (1 - share) * unknown:
            return paths, consistent
    return more, along
