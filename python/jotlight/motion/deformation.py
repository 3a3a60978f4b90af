"""The motion of each tile, for scenes that deform."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.affine import (
    SIGMAS,
    against_others,
    extrapolate,
    is_renewed,
    start_track,
    template_of,
    weights_at,
)
from jotlight.motion.blocks import Blocks
from jotlight.motion.regularize import Equations, Smoothness, fit_affine, solve_field
from jotlight.motion.scoring import Template, make_template, normal_equations
from jotlight.motion.segments import limit_length
from jotlight.motion.shrinkage import translation_of
from jotlight.motion.smoothing import smoothing_matrix
from jotlight.motion.track import Track, from_center

Array = npt.NDArray[np.float64]

SMOOTH, LESS_SMOOTH = Smoothness(1.0, 2.0), Smoothness(0.5, 1.0)
"""Smoothness of fields that differ from tile to tile, as those of waves and limbs do.

The weights of a field that is nearly affine are five times those of the first one.
"""

_JOINT_ROUNDS = 2

_TIME_PRIOR = 1.0
"""Information with which the displacements of neighboring blocks are added to each tile."""


def follow_tiles(blocks: Blocks, velocity: Array, smoothness: Smoothness = SMOOTH) -> Track:
    """Return the displacements of all blocks if each tile has its own motion.

    Parameters
    ----------
    blocks : Blocks
        The burst.
    velocity : ndarray of float, shape (2, rows, columns)
        Velocity of each tile around the middle.
    smoothness : Smoothness
        How similar the displacements of neighboring tiles are.
    """
    track = start_track(blocks, velocity)
    order = from_center(track)
    total = track.sums(order[0]) + track.sums(order[1])
    template = make_template(total, blocks.threads)
    for number, block in enumerate(order[2:], 3):
        extrapolate(track, block, velocity)
        for sigma in SIGMAS:
            improve_tiles(track, block, template, sigma, smoothness)
        track.known[block] = True
        total = total + track.nearby_sums(block)
        if is_renewed(number):
            template = make_template(total, blocks.threads)
    for _ in range(_JOINT_ROUNDS):
        improve_tiles_together(track, smoothness)
    return track


def improve_tiles(
    track: Track, block: int, template: Template, sigma: float, smoothness: Smoothness
) -> None:
    """Update the displacements of a block: first a translation, then each tile."""
    predicted = track.nodes[block].copy()
    equations = normal_equations(track.nearby_sums(block), template, sigma)
    step = translation_of(*fit_affine(equations, np.ones(predicted.shape[1:])))
    track.nodes[block] -= limit_length(step, 2 * sigma)
    equations = normal_equations(track.nearby_sums(block), template, sigma)
    now = track.nodes[block]
    step = solve_field(equations, now, predicted, smoothness) - now
    track.nodes[block] = now + limit_length(step, 2 * sigma)


def improve_tiles_together(
    track: Track, smoothness: Smoothness, template: Template | None = None
) -> None:
    """Update all blocks against a template, that of all of them.

    Fourth differences in time keep the displacements of each tile smooth.
    """
    number = len(track.nodes)
    if template is None:
        template = template_of(track)
    old, new = track.nodes, track.nodes.copy()
    for block in range(number):
        sums = track.nearby_sums(block)
        equations = normal_equations(sums, template, SIGMAS[-1])
        track.information[block] = equations.information
        smooth = old[block]
        if 2 <= block < number - 2:
            near = old[block - 1] + old[block + 1]
            smooth = 0.5 * old[block] + (4 * near - old[block - 2] - old[block + 2]) / 12
        relative = against_others(equations, sums, template)
        with_prior = _add_prior(relative, old[block] - smooth)
        new[block] = solve_field(with_prior, old[block], smooth, smoothness)
    track.nodes = new - _at_reference(track, new)


def _add_prior(equations: Equations, deviation: Array) -> Equations:
    """Return equations that also draw a tile toward a prediction."""
    information = equations.information.copy()
    information[[0, 2]] += _TIME_PRIOR
    return Equations(information, equations.right + _TIME_PRIOR * deviation)


def _at_reference(track: Track, nodes: Array) -> Array:
    """Return the displacements at the reference time, from a smooth curve through all blocks."""
    series = nodes.mean(axis=(2, 3))
    of_directions = track.information[:, [0, 2]].sum(axis=(2, 3))
    roots = np.sqrt(np.maximum(of_directions.mean(axis=0), 1e-9))
    information = of_directions.mean(axis=1) / max(float(of_directions.mean()), 1e-9)
    smooth = smoothing_matrix(series * roots, information)
    weights = weights_at(track.reference, track.blocks) @ smooth
    return np.asarray(np.tensordot(weights, nodes, axes=1))
