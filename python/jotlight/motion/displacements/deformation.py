"""The motion of each tile, for scenes that deform."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.displacements.affine import (
    against_others,
    agreement,
    sums_of_groups,
    template_of,
)
from jotlight.motion.displacements.deformation_prior import (
    DeformationPrior,
    Measurement,
    degrees_of_freedom,
    solve_deviations,
    with_likely_sizes,
)
from jotlight.motion.displacements.scoring import FAST, PRECISE, Template, normal_equations
from jotlight.motion.displacements.track import Track, from_center

_SIGMA = 2.0
"""Width of the filter with which further blocks are aligned."""

_JOINT_SIGMAS = (2.0, 1.0, 1.0, 1.0)
"""Widths of the filters in the rounds that align all blocks."""

_GROWTH = 1.5
"""Factor by which the number of known blocks grows from round to round."""

_MAX_STEP = 2.0
"""Maximum step of a tile, in widths of the filter."""


def follow_tiles(blocks: Blocks, start: Array) -> Track:
    """Return the displacements of all blocks if each tile has its own motion.

    The first template is that of the two central blocks. Blocks that are farther and farther away
    are then aligned with all nearer ones. The displacements of all tiles in all of these blocks are
    estimated together, so those of the nearer blocks tell where the others are searched.

    Parameters
    ----------
    blocks : Blocks
        The burst.
    start : ndarray of float, shape (n, 2, rows, columns)
        Displacements of a motion from which the tiles deviate.

    Returns
    -------
    Track
        The displacements, and their degrees of freedom.
    """
    track = Track.still(blocks)
    track.nodes = start.copy()
    estimate, order, number = _Estimate(track), from_center(track), 2
    while number < len(order):
        template = template_of(track, FAST, order[:number])
        number = min(len(order), max(number + 2, int(_GROWTH * number)))
        estimate.update(order[:number], template, _SIGMA)
    for sigma in _JOINT_SIGMAS:
        network = PRECISE if sigma <= _JOINT_SIGMAS[-1] else FAST
        estimate.update_together(template_of(track, network, order), sigma)
    track.freedom = estimate.degrees_of_freedom()
    return track


class _Estimate:
    """The most probable displacements of the tiles of a track, as far as blocks are known.

    Parameters
    ----------
    track : Track
        The track that is changed. The tiles deviate from its displacements at first.
    """

    def __init__(self, track: Track) -> None:
        self._track, self._expected = track, track.nodes.copy()
        self._prior = DeformationPrior.of_track(track)
        self._coefficients = np.zeros(self._prior.shape)
        self._measurement = Measurement(track.information, np.zeros_like(track.nodes))

    def update(self, known: npt.NDArray[np.intp], template: Template, sigma: float) -> None:
        """Update the displacements of all blocks from the bits of known ones."""
        self._measure(known, template, sigma, are_in_template=False)
        self._move(_MAX_STEP * sigma)

    def update_together(self, template: Template, sigma: float) -> None:
        """Update the displacements of all blocks against their template, and the prior."""
        every = np.arange(len(self._track.nodes))
        self._measure(every, template, sigma, are_in_template=True)
        self._prior, self._coefficients = with_likely_sizes(
            self._prior, self._measurement, self._coefficients
        )
        self._move(_MAX_STEP * sigma)

    def degrees_of_freedom(self) -> float:
        """Return how many deviations the bits of the latest update determine."""
        return degrees_of_freedom(self._prior, self._measurement)

    def _measure(
        self,
        known: npt.NDArray[np.intp],
        template: Template,
        sigma: float,
        *,
        are_in_template: bool,
    ) -> None:
        """Measure the deviations in known blocks, and find the most probable coefficients."""
        track = self._track
        information, right = np.zeros_like(track.information), np.zeros_like(track.nodes)
        for block in known:
            sums = track.nearby_sums(int(block))
            equations = normal_equations(sums, template, sigma)
            if are_in_template:
                equations = against_others(equations, sums, template)
            information[block], right[block] = equations.information, -equations.right
        # Something that appears or hides a tile is no motion of it.
        groups = sums_of_groups(track)
        weights = agreement(groups, template) if groups else 1.0
        information, right = weights * information, weights * right
        # The displacement errors are those of the present deviations.
        now = Measurement(information, right).products(track.nodes - self._expected)
        track.information, self._measurement = information, Measurement(information, right + now)
        self._coefficients = solve_deviations(self._prior, self._measurement, self._coefficients)

    def _move(self, longest: float) -> None:
        """Move the tiles to the most probable displacements, by a limited distance."""
        track = self._track
        step = self._expected + self._prior.displacements(self._coefficients) - track.nodes
        track.nodes = track.nodes + np.clip(step, -longest, longest)
