"""Updates of the displacements of tiles, block by block."""

import dataclasses

import numpy as np

from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.affine import against_others
from jotlight.motion.displacements.regularize import Equations
from jotlight.motion.displacements.scoring import Template
from jotlight.motion.displacements.smoothing import interpolation_bias
from jotlight.motion.displacements.tile_updates import _add_prior, _at_reference
from jotlight.motion.displacements.track import Track
from jotlight.motion.tiles import tile_counts
from moving import blocks_of, record


def test_a_prior_is_a_further_measurement():
    """The minimum of the energy with the prior is that of a direct sum of both energies."""
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(3, 4, 2, 2))
    matrices = roots @ roots.swapaxes(-1, -2)
    right, deviation = rng.normal(size=(2, 2, 3, 4))
    information = np.stack([matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]])
    share = 0.25
    size = 48, 64
    trials = np.full(size, 12, np.int32)
    block = dataclasses.replace(Sums.zeros(size), trials=(share * trials).astype(np.int32))
    template = Template(np.full(size, 0.3, np.float32), trials)
    relative = against_others(Equations(information, right), block, template)
    both = _add_prior(relative, deviation)
    for row, column in np.ndindex(3, 4):
        matrix = matrices[row, column] + np.eye(2)
        vector = right[:, row, column] / (1 - share) + deviation[:, row, column]
        found = both.information[:, row, column]
        np.testing.assert_allclose([[found[0], found[1]], [found[1], found[2]]], matrix, atol=1e-12)
        np.testing.assert_allclose(both.right[:, row, column], vector)


def test_the_displacement_at_the_reference_is_that_of_a_smooth_path():
    _, bits = record("shake")
    blocks = blocks_of(bits)
    shape, number = tile_counts(blocks.size), len(blocks.centers)
    # Where the path is interpolated between the centers of blocks, it is right on the mean.
    path = 0.01 * (blocks.centers - 10) ** 2 - interpolation_bias(3) * 2 * 0.01 * 3**2
    nodes = path[:, None, None, None] * np.ones((2, *shape))
    information = np.full((number, 3, *shape), 1e4)
    information[:, 1] = 0
    track = Track(blocks, 24, nodes, np.ones(number, bool), information)
    np.testing.assert_allclose(_at_reference(track, nodes), 0.01 * 14**2, atol=1e-3)
