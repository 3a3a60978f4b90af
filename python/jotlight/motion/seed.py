"""The first estimate of a motion: one velocity for each tile around the reference time."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Blocks, Sums
from jotlight.motion.regularize import Smoothness, fit_affine, solve_field
from jotlight.motion.scoring import blur, make_template, normal_equations
from jotlight.motion.tiles import tile_counts
from jotlight.motion.velocity import find_velocity

Array = npt.NDArray[np.float64]

_SMOOTHNESS = Smoothness(to_prediction=0.0, to_affine=4.0)

_ROUNDS = ((8, (8.0, 4.0, 2.0)), (4, (4.0, 2.0, 1.0)))
"""Rounds that refine the velocities: the frames before and after the reference time, as a fraction
1/n of all, and the widths of the filters."""

_MIN_FRAMES = 4
"""Minimum number of frames before or after the reference time that are compared."""


def estimate_velocities(blocks: Blocks, reference: int) -> Array:
    """Return the velocity of each tile in pixels per frame, (2, rows, columns)."""
    frames = len(blocks.bits)
    shape = tile_counts(blocks.size)
    velocity = _global_velocity(blocks, reference)
    field = np.broadcast_to(velocity.reshape(2, 1, 1), (2, *shape)).copy()
    for fraction, sigmas in _ROUNDS:
        half = min(max(_MIN_FRAMES, frames // fraction), reference, frames - reference)
        for sigma in sigmas:
            field = _refine(blocks, reference, half, field, sigma, use_tiles=False)
            field = _refine(blocks, reference, half, field, sigma, use_tiles=True)
    return field


def _refine(
    blocks: Blocks, reference: int, half: int, field: Array, sigma: float, *, use_tiles: bool
) -> Array:
    """Return better velocities, by comparing the frames before and after the reference time."""
    before, after = (
        _count_at_velocity(blocks, frames, field, reference)
        for frames in (range(reference - half, reference), range(reference, reference + half))
    )
    template = make_template(before, blocks.threads)
    equations = normal_equations(after, template, sigma)
    now = field * half
    if use_tiles:
        step = solve_field(equations, now, 0 * now, _SMOOTHNESS) - now
    else:
        step = -fit_affine(equations)
    return field + limit_length(step, 1.5 * sigma) / half


def _count_at_velocity(blocks: Blocks, frames: range, field: Array, reference: int) -> Sums:
    """Return the sums of frames whose points move at a constant velocity."""
    times = frames.start, frames.stop
    fields = field * (times[0] - reference), field * (times[1] - reference)
    return blocks.count(frames, fields, times)


def limit_length(vectors: Array, longest: float) -> Array:
    """Return vectors (2, ...), shortened to a maximum length where they are longer."""
    length = np.sqrt((vectors**2).sum(axis=0))
    return np.asarray(vectors * np.minimum(1, longest / np.maximum(length, 1e-9)))


def _global_velocity(blocks: Blocks, reference: int) -> Array:
    """Return the velocity of the whole image that makes the sum of frames sharpest, (2,)."""
    frames = len(blocks.bits)
    available = min(reference, frames - reference)
    lengths = {max(1, frames // number) for number in (256, 128, 64)}
    candidates = [
        np.zeros(2),
        *(
            find_velocity(blocks.bits, reference, length, blocks.threads)
            for length in sorted(lengths)
        ),
    ]
    half = min(max(_MIN_FRAMES, frames // 16), available)
    shape = tile_counts(blocks.size)
    sharpness = []
    for velocity in candidates:
        field = np.broadcast_to(velocity.reshape(2, 1, 1), (2, *shape))
        sums = _count_at_velocity(
            blocks, range(reference - half, reference + half), field, reference
        )
        fraction_of_ones = sums.ones / np.maximum(sums.trials, 1)
        band = blur(fraction_of_ones, 1.5) - blur(fraction_of_ones, 6)
        border = [min(24, length // 4) for length in blocks.size]
        inner = band[border[0] : -border[0] or None, border[1] : -border[1] or None]
        sharpness.append(float((inner**2).mean()))
    return candidates[int(np.argmax(sharpness))]
