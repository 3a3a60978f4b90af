"""Segments: parts of a scene that move differently, and their velocities.

A candidate velocity is right where the sum of frames along it is sharp. So its *energy*, the power
of the details of this sum above that of noise, is compared with those of other velocities.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Blocks, Sums
from jotlight.motion.regularize import fit_affine
from jotlight.motion.scoring import blur, make_template, normal_equations
from jotlight.motion.tiles import mean_tiles, tile_counts
from jotlight.motion.velocity import find_velocities

Array = npt.NDArray[np.float64]

_FINE, _COARSE = 1.5, 6.0
"""Standard deviations of the filters between which details are compared, in pixels."""

_ENERGY_BLUR = 8.0
"""Standard deviation of the filter that averages the energy, in pixels."""

_MIN_TILES = 4
"""Minimum number of tiles of a segment."""

_MIN_ENERGY = 0.05
"""Minimum energy of a segment, as a fraction of that of the strongest one."""

_MIN_CLEARNESS = 1.5
"""Minimum energy of a tile of some velocity, in standard deviations of that of noise."""

_MOST_PROBABLE = 4
"""Number of velocities that are refined if no segment is clear."""

_ROUNDS = ((8, (4.0, 2.0)), (4, (2.0, 1.0)))
"""Rounds that refine a velocity: the frames before and after the reference time, as a fraction 1/n
of all, and the widths of the filters."""

_MIN_FRAMES = 4
"""Minimum number of frames before or after the reference time that are compared."""

_MAX_COUNTED = 128
"""Maximum number of frames of a sum. Of more frames, every second, third, or nth is counted."""


@dataclasses.dataclass
class Segment:
    """A part of the scene with one affine motion."""

    velocity: Array
    """Velocity of each tile in pixels per frame, (2, rows, columns)."""
    weights: Array
    """Fraction of each tile that belongs to the segment, (rows, columns)."""
    energy: float
    """Energy of its tiles along its velocity."""


def find_segments(blocks: Blocks, reference: int) -> list[Segment]:
    """Return the segments of a scene around a reference time, the strongest first."""
    shape = tile_counts(blocks.size)
    candidates = find_velocities(blocks.burst, reference, blocks.threads)
    fields = [np.broadcast_to(each.reshape(2, 1, 1), (2, *shape)).copy() for each in candidates]
    energies = [_energy(blocks, reference, field) for field in fields]
    if not _is_clear(blocks, reference, energies):
        return [_find_one(blocks, reference, fields, energies)]
    found: list[int] = []
    strongest = 0.0
    while len(found) < len(fields):
        labels = _majority(energies)
        own = [
            -np.inf if index in found else float(energies[index][labels == index].clip(0).sum())
            for index in range(len(fields))
        ]
        index = int(np.argmax(own))
        tiles = labels == index
        if found and (tiles.sum() < _MIN_TILES or own[index] < _MIN_ENERGY * strongest):
            break
        strongest = max(strongest, own[index])
        found.append(index)
        refined = _refine(blocks, reference, fields[index], tiles.astype(float))
        energy = _energy(blocks, reference, refined)
        if energy[tiles].sum() > energies[index][tiles].sum():
            fields[index], energies[index] = refined, energy
    labels = _majority([energies[index] for index in found])
    return [
        Segment(
            fields[index],
            (labels == position).astype(float),
            float(energies[index][labels == position].sum()),
        )
        for position, index in enumerate(found)
        if len(found) == 1 or (labels == position).sum() >= _MIN_TILES
    ]


def _is_clear(blocks: Blocks, reference: int, energies: list[Array]) -> bool:
    """Return whether the tiles of some velocity have clearly more energy than noise."""
    trials = min(2 * central_half(blocks, reference), _MAX_COUNTED) * blocks.trials
    # The energy of noise fluctuates less than its mean: it is averaged over a wider filter.
    noise = _FINE / _ENERGY_BLUR / (trials * 4 * np.pi * _FINE**2)
    labels = _majority(energies)
    of_tiles = [
        energy[labels == index].mean()
        for index, energy in enumerate(energies)
        if (labels == index).sum() >= _MIN_TILES
    ]
    return max(of_tiles, default=0.0) > _MIN_CLEARNESS * noise


def _find_one(
    blocks: Blocks, reference: int, fields: list[Array], energies: list[Array]
) -> Segment:
    """Return the whole scene as one segment, with the best of the most probable velocities."""
    everywhere = np.ones(fields[0].shape[1:])
    totals = [float(energy.sum()) for energy in energies]
    best = int(np.argmax(totals))
    result = fields[best], totals[best]
    for index in np.argsort(totals)[::-1][:_MOST_PROBABLE]:
        refined = _refine(blocks, reference, fields[index], everywhere)
        energy = float(_energy(blocks, reference, refined).sum())
        if energy > result[1]:
            result = refined, energy
    return Segment(result[0], everywhere, result[1])


def _energy(blocks: Blocks, reference: int, field: Array) -> Array:
    """Return the energy of the sum of frames along a velocity, (rows, columns)."""
    half = central_half(blocks, reference)
    frames = range(reference - half, reference + half)
    return energy_of(count_at_velocity(blocks, frames, field, reference))


def central_half(blocks: Blocks, reference: float) -> int:
    """Return the number of frames before and after the reference time whose energy is compared."""
    return max(1, int(min(reference, len(blocks.burst) - reference)) // 2)


def energy_of(sums: Sums) -> Array:
    """Return the energy of sums, (rows, columns), in units of the variance of a bit."""
    known = (sums.trials > 0).astype(np.float32)
    fraction = sums.ones / np.maximum(sums.trials, 1)
    mean = blur(fraction * known, _COARSE) / np.maximum(blur(known, _COARSE), 1e-3)
    details = blur((fraction - mean) * known, _FINE)
    variance = np.clip(mean * (1 - mean), 1e-4, None)
    # The filter averages the noise of 4 π σ² pixels.
    noise = variance / np.maximum(sums.trials, 1) / (4 * np.pi * _FINE**2)
    energy = blur((details**2 - noise) / variance, _ENERGY_BLUR)
    return mean_tiles(energy)


def _majority(energies: list[Array]) -> npt.NDArray[np.intp]:
    """Return the index of the largest energy of each tile, most frequent among its neighbors."""
    from scipy.ndimage import uniform_filter

    labels = np.argmax(energies, axis=0)
    votes = [
        uniform_filter((labels == index).astype(float), 3, mode="nearest")
        for index in range(len(energies))
    ]
    return np.asarray(np.argmax(votes, axis=0))


def _refine(blocks: Blocks, reference: int, field: Array, weights: Array) -> Array:
    """Return a better affine velocity, from the frames before and after the reference time."""
    available = min(reference, len(blocks.burst) - reference)
    for fraction, sigmas in _ROUNDS:
        half = min(max(_MIN_FRAMES, len(blocks.burst) // fraction), available)
        for sigma in sigmas:
            before, after = (
                count_at_velocity(blocks, frames, field, reference)
                for frames in (
                    range(reference - half, reference),
                    range(reference, reference + half),
                )
            )
            template = make_template(before, blocks.threads)
            equations = normal_equations(after, template, sigma)
            step, _ = fit_affine(equations, weights)
            field = field - limit_length(step, 1.5 * sigma) / half
    return field


def count_at_velocity(blocks: Blocks, frames: range, field: Array, reference: int) -> Sums:
    """Return the sums of frames whose points move at a constant velocity."""
    frames = frames[:: -(-len(frames) // _MAX_COUNTED)]
    times = frames.start, frames.stop
    fields = field * (times[0] - reference), field * (times[1] - reference)
    return blocks.count(frames, fields, times)


def limit_length(vectors: Array, longest: float) -> Array:
    """Return vectors (2, ...), shortened to a maximum length where they are longer."""
    length = np.sqrt((vectors**2).sum(axis=0))
    return np.asarray(vectors * np.minimum(1, longest / np.maximum(length, 1e-9)))
