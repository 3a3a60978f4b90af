"""Updates of the displacements of tiles, block by block, which may differ between neighbors."""

import numpy as np

from jotlight.array_types import Array
from jotlight.motion.displacements.affine import SIGMAS, against_others, template_of, weights_at
from jotlight.motion.displacements.regularize import Equations, Smoothness, fit_affine, solve_field
from jotlight.motion.displacements.scoring import Template, normal_equations
from jotlight.motion.displacements.segments import limit_length
from jotlight.motion.displacements.shrinkage import translation_of
from jotlight.motion.displacements.smoothing import smoothing_matrix
from jotlight.motion.displacements.track import Track

_SMOOTHNESS = Smoothness(1.0, 2.0)
"""Smoothness of fields that differ from tile to tile, as those of waves and limbs do.

The weights of a field that is nearly affine are five times these.
"""

_TIME_PRIOR = 1.0
"""Information with which the displacements of neighboring blocks are added to each tile."""


def improve_tiles(track: Track, block: int, template: Template, sigma: float) -> None:
    """Update the displacements of a block: first a translation, then each tile."""
    predicted = track.nodes[block].copy()
    equations = normal_equations(track.nearby_sums(block), template, sigma)
    step = translation_of(*fit_affine(equations, np.ones(predicted.shape[1:])))
    track.nodes[block] -= limit_length(step, 2 * sigma)
    equations = normal_equations(track.nearby_sums(block), template, sigma)
    now = track.nodes[block]
    step = solve_field(equations, now, predicted, _SMOOTHNESS) - now
    track.nodes[block] = now + limit_length(step, 2 * sigma)


def improve_tiles_together(track: Track, template: Template | None = None) -> None:
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
        new[block] = solve_field(with_prior, old[block], smooth, _SMOOTHNESS)
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
