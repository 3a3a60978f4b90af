"""The motion of a scene, estimated from its bits."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Blocks, Sums
from jotlight.motion.motion import Motion
from jotlight.motion.regularize import (
    Equations,
    Smoothness,
    fit_affine,
    nearest_affine,
    solve_field,
)
from jotlight.motion.scoring import Template, make_template, normal_equations
from jotlight.motion.seed import estimate_velocities, limit_length
from jotlight.motion.selection import gain_between, likelihood_gain
from jotlight.motion.smoothing import smoothing_weights
from jotlight.motion.tiles import tile_counts
from jotlight.motion.track import Track

Array = npt.NDArray[np.float64]

_SMOOTHNESS = Smoothness()
_SIGMAS = (2.0, 1.0)
"""Widths of the filters with which each block is aligned."""

_JOINT_ROUNDS = 2

_TIME_PRIOR = 1.0
"""Information with which the displacements of neighboring blocks are added to each tile."""

_AFFINE_PARAMETERS = 6
"""Number of parameters of an affine motion of each block. A model must gain as many nats."""

_FREE_SHARE_OF_TILES = 0.1
"""Share of the displacements of tiles that are free, in spite of their neighbors."""

_MIN_SHARE_OF_OTHERS = 0.3
"""Smallest assumed share of the other blocks in the template."""


def divide(frames: int) -> npt.NDArray[np.intp]:
    """Return the first frame of each block, and the number of frames.

    There are T/8 blocks, but at least 16 and at most 32.
    """
    number = int(np.clip(frames / 8, 16, 32))
    return np.round(np.linspace(0, frames, number + 1)).astype(np.intp)


def estimate(
    blocks: Blocks,
    reference: int,
    *,
    use_tiles: bool,
    velocity: Array,
) -> tuple[Track, Array]:
    """Return the displacements of all blocks and the information about them.

    Parameters
    ----------
    blocks : Blocks
        The burst.
    reference : int
        Time at which displacements are 0.
    use_tiles : bool
        Whether each tile has its own motion. Otherwise the motion is affine.
    velocity : ndarray of float, shape (2, rows, columns)
        Velocity of each tile around the reference time.
    """
    if not use_tiles:
        velocity = nearest_affine(velocity)
    track = _start(blocks, reference, velocity)
    order = track.from_center()
    total = track.sums(order[0]) + track.sums(order[1])
    template = make_template(total, blocks.threads)
    for number, block in enumerate(order[2:]):
        _extrapolate(track, order[: number + 2], block, velocity)
        for sigma in _SIGMAS:
            _improve(track, block, template, sigma, use_tiles)
        track.known[block] = True
        total = total + track.sums(block)
        if number % 2 == 1 and (number < 8 or number % 4 == 3):
            template = make_template(total, blocks.threads)
    for _ in range(_JOINT_ROUNDS):
        information = _improve_together(track, use_tiles)
    return track, information


def _start(blocks: Blocks, reference: int, velocity: Array) -> Track:
    """Return a track whose two central blocks move at the velocity of the seed."""
    centers = blocks.centers
    nodes = np.zeros((len(centers), 2, *tile_counts(blocks.size)))
    track = Track(blocks, reference, nodes, np.zeros(len(centers), bool))
    for block in track.from_center()[:2]:
        nodes[block] = velocity * (centers[block] - reference)
        track.known[block] = True
    return track


def _extrapolate(track: Track, done: npt.NDArray[np.intp], block: int, velocity: Array) -> None:
    """Predict the displacements of a block from those of its two neighbors toward the center."""
    centers = track.blocks.centers
    near = int(min(done, key=lambda other: abs(other - block)))
    far = 2 * near - block
    if 0 <= far < len(centers) and track.known[far]:
        velocity = (track.nodes[near] - track.nodes[far]) / (centers[near] - centers[far])
    track.nodes[block] = track.nodes[near] + velocity * (centers[block] - centers[near])


def _improve(track: Track, block: int, template: Template, sigma: float, use_tiles: bool) -> None:
    """Update the displacements of a block: first an affine part, then each tile."""
    predicted = track.nodes[block].copy()
    equations = normal_equations(track.sums(block), template, sigma)
    track.nodes[block] -= limit_length(fit_affine(equations), 2 * sigma)
    if use_tiles:
        equations = normal_equations(track.sums(block), template, sigma)
        now = track.nodes[block]
        step = solve_field(equations, now, predicted, _SMOOTHNESS) - now
        track.nodes[block] = now + limit_length(step, 2 * sigma)


def _improve_together(track: Track, use_tiles: bool) -> Array:
    """Update all blocks against the template of all of them, and return the information.

    Fourth differences in time keep the displacements of each tile smooth.
    """
    number = len(track.nodes)
    sums = [track.sums(block) for block in range(number)]
    total = Sums.total(sums)
    template = make_template(total, track.blocks.threads)
    old, new = track.nodes, track.nodes.copy()
    information = []
    for block, each in enumerate(sums):
        equations = normal_equations(each, template, _SIGMAS[-1])
        information.append(equations.information)
        share = float(each.trials.mean() / max(total.trials.mean(), 1e-9))
        smooth = old[block]
        if 2 <= block < number - 2:
            near = old[block - 1] + old[block + 1]
            smooth = 0.5 * old[block] + (4 * near - old[block - 2] - old[block + 2]) / 12
        with_prior = _add_prior(equations, old[block] - smooth, share)
        if use_tiles:
            new[block] = solve_field(with_prior, old[block], smooth, _SMOOTHNESS)
        else:
            new[block] = old[block] - fit_affine(with_prior)
    track.nodes = new
    track.nodes = new - _at_reference(track, np.stack(information))
    return np.stack(information)


def _add_prior(equations: Equations, deviation: Array, share: float) -> Equations:
    """Return equations that also draw a tile toward a prediction.

    The block itself is a share of the template, which makes its apparent error smaller.
    """
    information = equations.information.copy()
    information[[0, 2]] += _TIME_PRIOR
    right = equations.right / max(1 - share, _MIN_SHARE_OF_OTHERS)
    return Equations(information, right + _TIME_PRIOR * deviation)


def _at_reference(track: Track, information: Array) -> Array:
    """Return the displacements at the reference time, from a smooth curve through all blocks."""
    centers = track.blocks.centers
    place = float(np.interp(track.reference, centers, np.arange(len(centers))))
    series = track.nodes.mean(axis=(2, 3))
    of_blocks = information[:, [0, 2]].sum(axis=(2, 3)).mean(axis=0)
    weights = smoothing_weights(series, 1 / np.maximum(of_blocks, 1e-9), place)
    return np.asarray(np.tensordot(weights, track.nodes, axes=1))


def as_motion(track: Track, information: Array, model: str) -> Motion:
    """Return the motion of a track."""
    return Motion(
        track.nodes.astype(np.float32),
        track.blocks.centers,
        track.blocks.size,
        track.reference,
        model,
        information.astype(np.float32),
    )


def estimate_motion(blocks: Blocks, reference: int) -> Motion:
    """Return the motion of the model that explains the bits best."""
    velocity = estimate_velocities(blocks, reference)
    rows, columns = tile_counts(blocks.size)
    number = len(blocks.centers)
    still = Track(blocks, reference, np.zeros((number, 2, rows, columns)), np.ones(number, bool))
    best = still, np.zeros((number, 3, rows, columns)), "none"
    affine, tiles = (
        estimate(blocks, reference, use_tiles=use_tiles, velocity=velocity)
        for use_tiles in (False, True)
    )
    if likelihood_gain(affine[0], still) > _AFFINE_PARAMETERS * number:
        best = *affine, "affine"
        gain = gain_between(affine[0], tiles[0])
    else:
        gain = likelihood_gain(tiles[0], still)
    if gain > _FREE_SHARE_OF_TILES * 2 * number * rows * columns:
        best = *tiles, "tiles"
    return as_motion(*best)
