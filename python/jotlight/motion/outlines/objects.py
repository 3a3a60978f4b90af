"""Objects that the segments of a scene do not explain: small or dim ones.

The energy of a small object is lost in that of the background. So the background is subtracted:
what remains of all blocks is correlated in small windows, pair by pair, and the correlations of all
pairs are added along each velocity. An object is accepted if the bits gain by it.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Mask
from jotlight.motion.counts.equivalent import equivalent_sums
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.affine import follow_segment, improve_inside, start_track
from jotlight.motion.displacements.scoring import make_template
from jotlight.motion.displacements.segments import Segment, refine_velocity
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.displacements.velocity_scores import BIN, MAX_BLOCKS, MIN_PEAK, VelocityScores
from jotlight.motion.outlines.depth import (
    ComparedBits,
    object_gains,
    refine_outlines,
    without_absent,
)
from jotlight.motion.outlines.likelihood_gain import likelihood_gain
from jotlight.motion.tiles import add_squares, mean_tiles, tile_counts

MAX_OBJECTS = 5
"""Maximum number of objects of a scene."""

_MAX_TRIED, _MAX_FOLLOWED = 8, 2
"""Maximum numbers of velocities that are tried for each object, and that are followed."""

_SAME = 6.0
"""Distance in pixels, over the whole burst, up to which velocities are the same."""

_LAGS = (1, 2, 3, 4, 6)
"""Distances in blocks of the pairs that are correlated."""

_STRIDE = 48 // BIN
"""Maximum distance of neighboring windows, in bins."""

_MAX_PEAKS = 3
"""Maximum number of velocities of a window."""

_SCALE = 256.0
"""Factor of residuals, which are rounded to whole numbers."""

_MIN_GAIN = 30.0
"""Minimum gain in nats by an object, beyond the cost of its outline."""

_MIN_SHARE = 0.03
"""Minimum gain by an object, as a fraction of the largest gain by another one."""

PARAMETERS = 6
"""Number of parameters of an affine motion of each block. A motion must gain as many nats."""

_MIN_PIXELS = 64
"""Minimum number of pixels of an object."""


def add_objects(paths: Paths, most: int = MAX_OBJECTS) -> Paths:
    """Return paths with further tracks in front, those of objects that move by themselves.

    An object is added if the bits are then more likely. In bright light, the first false object
    ends the search, which would take long. `most` is the maximum number of objects.
    """
    for _ in range(most):
        more = _with_object(paths)
        if more is None or more_likely(paths, more) is paths:
            break
        paths = more
    return paths


def more_likely(fewer: Paths, more: Paths) -> Paths:
    """Return the paths that explain the bits better: those with fewer tracks, or with more.

    Objects that are not there at the reference time hide good bits of the background.
    """
    needed = PARAMETERS * len(more.blocks.centers) * (len(more.tracks) - len(fewer.tracks))
    gain = likelihood_gain(more) - likelihood_gain(fewer)
    return more if gain > needed else fewer


def _with_object(paths: Paths) -> Paths | None:
    """Return paths with the object that gains most, or None if none gains enough."""
    velocities = _residual_velocities(paths)[:_MAX_TRIED]
    if not velocities:
        return None
    bits = ComparedBits.of(paths)
    found = [each for velocity in velocities for each in _candidates(paths, bits, velocity)]
    for candidate in _best_distinct(found, len(paths.blocks.burst)):
        more = _with_candidate(paths, candidate)
        if more is not None:
            return more
    return None


@dataclasses.dataclass(frozen=True)
class _Candidate:
    """A constant velocity of an object."""

    velocity: Array
    """In pixels per frame, (2, rows, columns)."""
    pixels: Mask
    """The pixels that gain by it, (H, W)."""
    net: float
    """Their gain in nats."""


def _candidates(paths: Paths, bits: ComparedBits, velocity: Array) -> list[_Candidate]:
    """Return a velocity and a better one, as far as they gain enough.

    The places of peaks are those of a grid. And an object that moves slowly is a part of the
    template, so what remains of it seems to move faster.
    """
    found = []
    for _ in range(2):
        gain = bits.with_track(_constant(paths, velocity)).gain(len(paths.tracks))
        pixels = gain.pixels()
        if pixels.sum() < _MIN_PIXELS:
            break
        if (net := gain.net(pixels)) > _MIN_GAIN:
            found.append(_Candidate(velocity, pixels, net))
        weights = mean_tiles(pixels.astype(np.float32))
        velocity = refine_velocity(paths.blocks, velocity, weights)
    return found


def _best_distinct(found: list[_Candidate], frames: int) -> list[_Candidate]:
    """Return the candidates that are followed: those with the largest gains."""
    kept: list[_Candidate] = []
    for candidate in sorted(found, key=lambda each: -each.net):
        if _distinct([candidate.velocity], [each.velocity for each in kept], frames):
            kept.append(candidate)
    return kept[:_MAX_FOLLOWED]


def _with_candidate(paths: Paths, candidate: _Candidate) -> Paths | None:
    """Return paths with an object whose motion is followed, or None if it gains too little."""
    blocks, index = paths.blocks, len(paths.tracks)
    start = Segment(candidate.velocity, np.ones(tile_counts(blocks.size)), energy=0.0, half=0)
    track = follow_segment(blocks, start, candidate.pixels)
    labels = np.where(candidate.pixels, np.uint8(index), paths.labels)
    more = _inside_outlines(without_absent(refine_outlines(Paths([*paths.tracks, track], labels))))
    gains = [gain.net(more.labels == each) for each, gain in enumerate(object_gains(more), 1)]
    needed = max(_MIN_GAIN, _MIN_SHARE * max(gains))
    has_enough = (more.labels == index).sum() >= _MIN_PIXELS and gains[-1] > needed
    return more if has_enough else None


def _inside_outlines(paths: Paths) -> Paths:
    """Return paths whose motions are those of the pixels inside the outlines, if these gain.

    The pixels from which a motion was followed may belong to several objects.
    """
    better = without_absent(refine_outlines(improve_inside(paths)))
    return better if likelihood_gain(better) > likelihood_gain(paths) else paths


def _constant(paths: Paths, velocity: Array) -> Track:
    """Return the track of a constant velocity."""
    track = start_track(paths.blocks, velocity)
    times = paths.blocks.centers - paths.reference
    track.nodes = times[:, None, None, None] * velocity
    track.known[:] = True
    return track


def _residual_velocities(paths: Paths) -> list[Array]:
    """Return velocities of what no track explains, (2, rows, columns) each, the clearest first."""
    track, blocks = paths.tracks[0], paths.blocks
    residuals, frames = _residuals(paths)
    if len(residuals) < 2:
        return []
    found = VelocityScores(residuals, frames, _LAGS, blocks.threads)
    base = track.velocity()
    peaks: list[tuple[float, Array]] = []
    for scores in found.of_windows(_STRIDE)[0]:
        for height, row, column in _peaks(scores):
            relative = np.array([found.line[row], found.line[column]])
            peaks.append((height, base + relative[:, None, None]))
    peaks.sort(key=lambda pair: -pair[0])
    known = [each.velocity() for each in paths.tracks]
    return _distinct([velocity for _, velocity in peaks], known, len(blocks.burst))


def _peaks(scores: npt.NDArray[np.float32]) -> list[tuple[float, int, int]]:
    """Return the heights of the highest peaks in standard deviations, with their places."""
    from scipy.ndimage import maximum_filter

    heights = (scores - scores.mean()) / max(float(scores.std()), 1e-9)
    is_peak = (heights == maximum_filter(heights, 3)) & (heights >= MIN_PEAK)
    is_peak[[0, -1]] = is_peak[:, [0, -1]] = False
    rows, columns = np.nonzero(is_peak)
    peaks = [
        (float(heights[row, column]), int(row), int(column))
        for row, column in zip(rows, columns, strict=True)
    ]
    return sorted(peaks, reverse=True)[:_MAX_PEAKS]


def _distinct(velocities: list[Array], known: list[Array], frames: int) -> list[Array]:
    """Return the velocities that differ from known ones, and from all before."""
    kept: list[Array] = []
    for velocity in velocities:
        if all(
            float(np.hypot(*(velocity - other)).max()) * frames >= _SAME for other in known + kept
        ):
            kept.append(velocity)
    return kept


def _residuals(paths: Paths) -> tuple[npt.NDArray[np.int32], float]:
    """Return what remains of the counts along the first track, (n, h, w), and frames per block.

    Where objects cover it, nothing remains.
    """
    track, number = paths.tracks[0], len(paths.blocks.centers)
    threads = paths.blocks.threads
    length = -(-number // MAX_BLOCKS)
    groups = [
        Sums.total(
            (
                track.sums(block).masked(~paths.covered(0, block))
                for block in range(first, first + length)
            ),
            threads,
        )
        for first in range(0, number - length + 1, length)
    ]
    probability = make_template(Sums.total(groups, threads), threads).probability
    deviation = np.sqrt(probability * (1 - probability))
    residuals = []
    for group in groups:
        sums = equivalent_sums(group, probability)
        each = (sums.ones - sums.trials * probability) / deviation
        residuals.append(add_squares(np.rint(_SCALE * each), BIN))
    frames = length * float(np.diff(paths.blocks.edges).mean())
    return np.stack(residuals).astype(np.int32), frames
