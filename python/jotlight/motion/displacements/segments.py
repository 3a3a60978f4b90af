"""Segments: parts of a scene that move differently, and their velocities.

A candidate velocity is right where the sum of frames along it is sharp. So its *energy*, the power
of the details of this sum above that of noise, is compared with those of other velocities.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.blur import blur
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.equivalent import equivalent_sums
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.regularize import fit_affine
from jotlight.motion.displacements.scoring import make_blurred_template, normal_equations
from jotlight.motion.displacements.shrinkage import shrink_field
from jotlight.motion.displacements.velocity import find_velocities
from jotlight.motion.labels import choose
from jotlight.motion.tiles import TILE, add_squares, mean_tiles


class _Candidate(NamedTuple):
    """A velocity that a part of the scene may have."""

    velocity: Array
    """Velocity of each tile in pixels per frame, (2, rows, columns)."""
    energy: Array
    """Energy of each tile along it, (rows, columns)."""


_FINE, _COARSE = 1.5, 6.0
"""Standard deviations of the filters between which details are compared, in pixels."""

_SQUARE = 2
"""Width of the squares whose counts are added before details are compared, in pixels."""

_ENERGY_BLUR = 8.0
"""Standard deviation of the filter that averages the energy, in pixels."""

_MIN_TILES = 4
"""Minimum number of tiles of a segment."""

_MIN_ENERGY = 0.02
"""Minimum energy of a segment, as a fraction of that of the strongest one."""

_CLEAR, _LESS_CLEAR = 4.0, 2.5
"""Number of standard deviations by which an energy clearly differs from another one.

The lower number is that for segments that are tried if the more probable ones explain nothing.
"""

_CORRELATED = 3.0
"""Number of tiles over which the noise of the energy is correlated."""

_CHOSEN = 0.6
"""Energy of noise in a tile that was chosen for its energy, in standard deviations."""

_STARTS = 3
"""Number of velocities that are refined for the whole scene."""

_CAPTURE = 4.0
"""Distance in pixels over which the refinement surely finds a motion."""

_ROUNDS = ((8, (4.0, 2.0)), (4, (2.0, 1.0)))
"""Rounds that refine a velocity: the frames before and after the reference time, as a fraction 1/n
of all, and the widths of the filters."""

_MIN_FRAMES = 4
"""Minimum number of frames before or after the reference time that are compared."""

_ENOUGH = 4
"""A motion is refined from at most this many times the frames that show the region well."""

_LIGHT = 32.0
"""Number of ones per pixel that suffice. Of more frames, every second, third, or nth is counted."""

_DIM = 8.0
"""Number of ones per pixel that are counted even if they need more than the usual frames."""

_MIN_COUNTED, _MAX_COUNTED = 32, 128
"""Minimum and maximum number of frames that are usually counted, if there are more."""


@dataclasses.dataclass
class Segment:
    """A part of the scene with one affine motion."""

    velocity: Array
    """Velocity of each tile in pixels per frame, (2, rows, columns)."""
    weights: Array
    """Fraction of each tile that belongs to the segment, (rows, columns)."""
    energy: float
    """Energy of its tiles along its velocity."""
    half: int
    """Number of frames before and after the reference time whose energy this is."""


@dataclasses.dataclass(frozen=True)
class _Scene:
    """The frames of a scene whose energies are compared."""

    blocks: Blocks
    half: int
    """Their number before the middle, and after it."""


def find_segments(blocks: Blocks, *, is_slow: bool = False) -> list[list[Segment]]:
    """Return one or two divisions of a scene into segments, the more probable one first.

    One search begins with the best affine velocity of the whole scene. The other begins with a
    constant velocity: an affine one may be a compromise between two parts that move differently.
    In dim light, it adds segments that are less clear. The segments of a division are in the order
    of their energies.

    Parameters
    ----------
    blocks : Blocks
        The burst.
    is_slow : bool
        Whether the energies are those of all frames, which differ more if parts move slowly.
        Otherwise, they are those of the central half, because velocities change.
    """
    half = blocks.half
    scene = _Scene(blocks, max(1, half if is_slow else half // 2))
    candidates = [
        _Candidate(velocity, _energy(scene, velocity)) for velocity in find_velocities(blocks)
    ]
    constant = [each for each in candidates if np.ptp(each.velocity, axis=(1, 2)).max() == 0]
    start = max(constant, key=lambda each: float(each.energy.sum()))
    divisions = [_add_segments(scene, _best_of_all(scene, candidates), candidates, _CLEAR)]
    several = _add_segments(scene, start, candidates, _LESS_CLEAR)
    if len(several) > 1:
        is_first = _majority([each.energy for each in several]) == 0
        divisions.append([_refined(scene, several[0], is_first), *several[1:]])
    noise = _noise(scene)
    divisions.sort(key=lambda parts: -_score([each.energy for each in parts], noise))
    return [_as_segments(parts, scene.half) for parts in divisions]


def _as_segments(parts: list[_Candidate], half: int) -> list[Segment]:
    """Return the segments with the given velocities, without small ones."""
    labels = _majority([each.energy for each in parts])
    segments = []
    for position, (velocity, energy) in enumerate(parts):
        tiles = labels == position
        if position == 0 or tiles.sum() >= _MIN_TILES:
            segments.append(
                Segment(velocity, tiles.astype(float), float(energy[tiles].sum()), half)
            )
    return sorted(segments, key=lambda segment: -segment.energy)


def _add_segments(
    scene: _Scene, start: _Candidate, candidates: list[_Candidate], clear: float
) -> list[_Candidate]:
    """Return a first velocity and others, as long as some region clearly has more energy.

    An energy is clear if it exceeds another one by `clear` standard deviations of noise.
    """
    found, remaining = [start], list(candidates)
    noise = _noise(scene)
    while remaining:
        best = np.max([each.energy for each in found], axis=0)
        regions = [_majority([best, each.energy]) == 1 for each in remaining]
        gains = [
            float((each.energy - best)[region].sum()) - _by_chance(int(region.sum()), noise, clear)
            for each, region in zip(remaining, regions, strict=True)
        ]
        index = int(np.argmax(gains))
        if gains[index] <= max(0.0, _MIN_ENERGY * float(start.energy.sum())):
            break
        found.append(_refined(scene, remaining.pop(index), regions[index]))
    return found


def _refined(scene: _Scene, part: _Candidate, region: npt.NDArray[np.bool_]) -> _Candidate:
    """Return a better velocity of a region, or the same if none is better."""
    velocity = refine_velocity(scene.blocks, part.velocity, region.astype(float))
    better = _Candidate(velocity, _energy(scene, velocity))
    return better if better.energy[region].sum() > part.energy[region].sum() else part


def _score(energies: list[Array], noise: float) -> float:
    """Return the energy of all tiles, without that by which a choice of velocities gains."""
    labels = _majority(energies)
    chosen = choose(labels, energies).sum()
    return float(chosen) - sum(
        _by_chance(int((labels == position).sum()), noise) for position in range(1, len(energies))
    )


def _best_of_all(scene: _Scene, candidates: list[_Candidate]) -> _Candidate:
    """Return the affine velocity with the most energy in the whole scene, from several starts."""
    everywhere = np.ones(candidates[0].energy.shape, bool)
    frames = max(_MIN_FRAMES, len(scene.blocks.burst) // _ROUNDS[0][0])
    totals = np.array([each.energy.sum() for each in candidates])
    by_chance = _by_chance(everywhere.size, _noise(scene))
    refined: list[_Candidate] = []
    for index in np.argsort(-totals)[:_STARTS]:
        start = candidates[index]
        # The refinement would end at the same velocity again.
        if any(abs(each.velocity - start.velocity).max() * frames <= _CAPTURE for each in refined):
            continue
        # Worse starts hardly ever end at a better velocity than one that is clearly better.
        if any(each.energy.sum() > totals[index] + by_chance for each in refined):
            break
        refined.append(_refined(scene, start, everywhere))
    return max(refined, key=lambda each: each.energy.sum())


def _noise(scene: _Scene) -> float:
    """Return the standard deviation of the energy of a tile without details."""
    blocks = scene.blocks
    trials = min(2 * scene.half, _most_counted(blocks)) * blocks.trials
    # The energy of noise fluctuates less than its mean: it is averaged over a wider filter.
    return _FINE / _ENERGY_BLUR / (trials * 4 * np.pi * _FINE**2)


def _by_chance(number: int, noise: float, clear: float = _CLEAR) -> float:
    """Return the gain of energy that a region with a number of tiles may have by chance.

    The energies of neighboring tiles are correlated. And the region was chosen for its energy.
    """
    return noise * (clear * math.sqrt(_CORRELATED * number) + _CHOSEN * number)


def _energy(scene: _Scene, field: Array) -> Array:
    """Return the energy of the sum of frames along a velocity, (rows, columns)."""
    blocks, middle = scene.blocks, scene.blocks.middle
    frames = range(middle - scene.half, middle + scene.half)
    return energy_of(count_at_velocity(blocks, frames, field), blocks.threads)


def energy_of(sums: Sums, threads: int | None) -> Array:
    """Return the energy of sums, (rows, columns), in units of the variance of a bit.

    Counts are added in squares, which the filter for details hardly notices.
    """
    in_view = min(1.0, float(sums.trials.max()) / max(sums.frames, 1))
    sums = equivalent_sums(sums)
    ones, trials = (add_squares(each, _SQUARE) for each in (sums.ones, sums.trials))
    known = (trials > 0).astype(np.float32)
    fraction = ones / np.where(trials > 0, trials, 1)
    coarse, fine = _COARSE / _SQUARE, _FINE / _SQUARE
    total, share = blur(np.stack([fraction * known, known]), coarse, threads)
    mean = total / np.maximum(share, 1e-3)
    details = blur((fraction - mean) * known, fine, threads)
    variance = np.clip(mean * (1 - mean), 1e-4, None)
    # The filter averages the noise of 4 π σ² squares: its square is a filter, too.
    noise = blur(known / np.maximum(trials, 1), fine / math.sqrt(2), threads)
    noise /= 4 * np.pi * fine**2
    # Where few frames show the scene, the energy of noise fluctuates much, so it has less weight.
    share = trials * np.float32(in_view / max(float(trials.max()), 1.0))
    weighted = share**2 * (details**2 / variance - noise)
    return mean_tiles(blur(weighted, _ENERGY_BLUR / _SQUARE, threads), TILE // _SQUARE)


def _majority(energies: list[Array]) -> npt.NDArray[np.intp]:
    """Return the index of the largest energy of each tile, most frequent among its neighbors."""
    from scipy.ndimage import uniform_filter

    labels = np.argmax(energies, axis=0)
    votes = [
        uniform_filter((labels == index).astype(float), 3, mode="nearest")
        for index in range(len(energies))
    ]
    return np.asarray(np.argmax(votes, axis=0))


def refine_velocity(blocks: Blocks, field: Array, weights: Array) -> Array:
    """Return a better affine velocity, from the frames before and after the middle."""
    middle = blocks.middle
    most = _ENOUGH * blocks.enough_frames(TILE**2 * float(weights.sum()))
    for fraction, sigmas in _ROUNDS:
        half = min(max(_MIN_FRAMES, len(blocks.burst) // fraction), blocks.half)
        for sigma in sigmas:
            before, after = (
                count_at_velocity(blocks, frames, field, most)
                for frames in (range(middle - half, middle), range(middle, middle + half))
            )
            template = make_blurred_template(before, blocks.threads)
            equations = normal_equations(after, template, sigma)
            step = shrink_field(*fit_affine(equations, weights))
            field = field - limit_length(step, 1.5 * sigma) / half
    return field


def count_at_velocity(blocks: Blocks, frames: range, field: Array, most: int | None = None) -> Sums:
    """Return the sums of at most a number of frames whose points move at a constant velocity."""
    enough = _most_counted(blocks)
    most = enough if most is None else min(enough, max(_MIN_COUNTED, most))
    frames = frames[:: -(-len(frames) // most)]
    times = frames.start, frames.stop
    fields = field * (times[0] - blocks.middle), field * (times[1] - blocks.middle)
    return blocks.count(frames, fields, times)


def _most_counted(blocks: Blocks) -> int:
    """Return the number of frames that have enough light together."""
    mean = max(blocks.mean_count, 1e-9)
    return int(np.clip(_LIGHT / mean, _MIN_COUNTED, max(_MAX_COUNTED, _DIM / mean)))


def limit_length(vectors: Array, longest: float) -> Array:
    """Return vectors (2, ...), shortened to a maximum length where they are longer."""
    length = np.sqrt((vectors**2).sum(axis=0))
    return np.asarray(vectors * np.minimum(1, longest / np.maximum(length, 1e-9)))
