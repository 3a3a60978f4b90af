"""The motion of a segment: an affine motion of each block, smooth in time."""

import dataclasses

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.equivalent import equivalent_sums
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.affine_curve import covariances_of, information_of, smooth_affine
from jotlight.motion.displacements.disagreement import chi_squared
from jotlight.motion.displacements.regularize import Equations, fit_affine
from jotlight.motion.displacements.scoring import (
    FAST,
    PRECISE,
    Template,
    make_template,
    normal_equations,
)
from jotlight.motion.displacements.segments import Segment, limit_length
from jotlight.motion.displacements.shrinkage import shrink_field, translation_of
from jotlight.motion.displacements.smoothing import cubic_weights, interpolation_bias
from jotlight.motion.displacements.track import Paths, Track, from_center
from jotlight.motion.tiles import affine_basis, affine_inverse, mean_tiles, tile_counts

SIGMAS = (2.0, 1.0)
"""Widths of the filters with which each block is aligned."""

_JOINT_SIGMAS, _WIDE_SIGMAS = (2.0, 1.0, 1.0, 1.0), (8.0, 4.0, 2.0)
"""Widths of the filters in the rounds that align all blocks together.

The wide ones follow the first round if its steps are long.
"""

_LONG = 0.4
"""Steps of the first round above this length in pixels show that single blocks lost their way."""

_ROUNDS = 2
"""Number of times that the motions of segments are improved after their outlines are known."""

_SMALL = 0.3
"""Steps up to this length in pixels need no further round with a narrower filter."""

_TINY = 0.1
"""Steps up to this length in pixels end the rounds of all blocks together."""

_MAX_STEP = 2.0
"""Longest step of a block, in widths of the filter."""

_FARTHEST = 4
"""Largest predicted displacement, in units of the length of the image."""

_GROUPS = 4
"""Number of groups of blocks that are compared with the template of all."""

_MAX_EXCESS = 0.3
"""Mean of χ² - 1 in a tile at which it has half its weight, if no more is usual."""

_BLOCKS_AT_ONCE = 16
"""Number of blocks whose sums are in memory together, if they are not kept."""

_MIN_SHARE_OF_OTHERS = 0.3
"""Smallest assumed share of the other blocks in the template."""


def follow_segment(
    blocks: Blocks, segment: Segment, pixels: npt.NDArray[np.bool_] | None = None
) -> Track:
    """Return the displacements of all blocks under the affine motion of a segment.

    Bright blocks are aligned with a part of their frames. Only some pixels (H, W) are aligned if
    they are given.
    """
    track = start_track(blocks.with_enough_light(), segment.velocity).inside(pixels)
    order = from_center(track)
    total = track.sums(order[0]) + track.sums(order[1])
    template, weights = make_template(total, blocks.threads), segment.weights
    for number, block in enumerate(order[2:], 3):
        extrapolate(track, block, segment.velocity)
        find_after_gap(track, int(block), template, weights)
        for sigma in SIGMAS:
            if improve_block(track, block, template, sigma, weights) <= _SMALL:
                break
        track.known[block] = True
        total += track.nearby_sums(block)
        if is_renewed(number) and number < len(order):
            template = make_template(total, blocks.threads)
            weights = segment.weights * agreement(sums_of_groups(track), template)
    _align_together(track, segment.weights)
    return track.inside(None).over(blocks)


def follow_together(blocks: Blocks, segment: Segment) -> Track:
    """Return the displacements of all blocks, which first move at the velocity of a segment.

    All of them are known from the beginning, so that no block is aligned by its light alone.
    """
    track = Track.still(blocks.with_enough_light())
    track.nodes = np.multiply.outer(track.blocks.centers - blocks.middle, segment.velocity)
    _align_together(track, segment.weights)
    return track.over(blocks)


def _align_together(track: Track, weights: Array) -> None:
    """Update all blocks together until the steps are short."""

    def step(sigma: float) -> float:
        # Wide filters do not show the details that the larger network adds.
        network = PRECISE if sigma <= SIGMAS[-1] else FAST
        return improve_together(track, weights, sigma, network=network)

    first, *others = _JOINT_SIGMAS
    if step(first) > _LONG:
        others = [*_WIDE_SIGMAS, *others]
    for sigma in others:
        if step(sigma) <= _TINY and sigma == others[-1]:
            break


def find_after_gap(track: Track, block: int, template: Template, weights: Array) -> None:
    """Find the translation of a block with light that follows blocks without light.

    The prediction for such a block has a large error. For other blocks, nothing changes.
    """
    is_lit = track.blocks.is_lit
    near = int(abs(np.flatnonzero(track.known & is_lit) - block).min())
    if near == 1 or not is_lit[block]:
        return
    for sigma in _WIDE_SIGMAS:
        equations = normal_equations(track.nearby_sums(block), template, sigma)
        step = translation_of(*fit_affine(equations, weights))
        track.nodes[block] -= limit_length(step, _MAX_STEP * sigma)


def start_track(blocks: Blocks, velocity: Array) -> Track:
    """Return a track of which only the two central blocks are known, and move at a velocity."""
    track = Track.still(blocks)
    track.known[:] = False
    for block in from_center(track)[:2]:
        track.nodes[block] = velocity * (blocks.centers[block] - blocks.middle)
        track.known[block] = True
    return track


def extrapolate(track: Track, block: int, velocity: Array) -> None:
    """Predict the displacements of a block from those of its two neighbors toward the center."""
    centers = track.blocks.centers
    known = np.flatnonzero(track.known)
    near = int(known[np.argmin(abs(known - block))])
    far = near + (1 if near > block else -1)
    if 0 <= far < len(centers) and track.known[far]:
        velocity = (track.nodes[near] - track.nodes[far]) / (centers[near] - centers[far])
    nodes = track.nodes[near] + velocity * (centers[block] - centers[near])
    # Beyond the view, nothing corrects the prediction.
    farthest = _FARTHEST * max(track.blocks.size)
    track.nodes[block] = np.clip(nodes, -farthest, farthest)


def is_renewed(number: int) -> bool:
    """Return whether the template is renewed after a number of blocks.

    It is when this number has doubled, and at every 16th block. Of more than 128 blocks, it is four
    times until the number has doubled, so that the time is proportional to the number of blocks.

    Examples
    --------
    >>> [number for number in range(1, 300) if is_renewed(number)][-8:]
    [80, 96, 112, 128, 160, 192, 224, 256]
    """
    return number.bit_count() == 1 or number % max(16, 1 << number.bit_length() >> 3) == 0


def improve_block(
    track: Track, block: int, template: Template, sigma: float, weights: Array
) -> float:
    """Update the displacements of a block, and return the length of the longest step."""
    equations = normal_equations(track.nearby_sums(block), template, sigma)
    step = limit_length(shrink_field(*fit_affine(equations, weights)), _MAX_STEP * sigma)
    track.nodes[block] -= step
    return float(np.hypot(*step).max())


def improve_together(
    track: Track, weights: Array, sigma: float = 1.0, network: str = PRECISE
) -> float:
    """Update all blocks against their template, as :func:`improve_against`.

    A network denoises the sums of all known blocks to make it.
    """
    template, agrees = template_and_agreement(track, network)
    return improve_against(track, template, weights * agrees, sigma)


def improve_against(track: Track, template: Template, weights: Array, sigma: float = 1.0) -> float:
    """Update all blocks against a template as a smooth curve in time.

    `weights` are those of the tiles. Return the root-mean-square length of the steps.
    """
    number, threads = len(track.nodes), track.blocks.threads
    shape = tile_counts(track.blocks.size)
    basis, to_parameters = affine_basis(shape), affine_inverse(shape)
    steps, matrices = _fit_blocks(track, template, sigma, weights)
    nodes = (track.nodes - steps).reshape(2 * number, -1)
    parameters = (nodes @ to_parameters.T).reshape(number, 6)
    at_reference = weights_at(track.reference, track.blocks)
    smooth = smooth_affine(parameters, matrices, threads)
    smooth -= at_reference @ smooth
    covariances = covariances_of(matrices)
    seen = track.blocks.is_lit * at_reference**2
    covariances = covariances + np.tensordot(seen, covariances, axes=1)
    displacements = (smooth.reshape(number, 2, 3) @ basis.T).reshape(track.nodes.shape)
    displacements = keep_velocities(displacements, track.blocks)
    length = float(np.sqrt(2 * np.mean((displacements - track.nodes) ** 2)))
    track.nodes = displacements
    information = information_of(covariances, basis, displacements.reshape(number, 2, -1))
    track.information = information.reshape(track.information.shape)
    track.information[~track.blocks.is_lit] = 0
    return length


def keep_velocities(nodes: Array, blocks: Blocks) -> Array:
    """Return displacements whose points keep their velocities before and after all light."""
    lit = np.flatnonzero(blocks.is_lit)
    if len(lit) < 2 or len(lit) == len(nodes):
        return nodes
    nodes, centers = nodes.copy(), blocks.centers
    for end, inner, outside in (
        (lit[0], lit[1], slice(0, lit[0])),
        (lit[-1], lit[-2], slice(lit[-1] + 1, None)),
    ):
        velocity = (nodes[end] - nodes[inner]) / (centers[end] - centers[inner])
        nodes[outside] = nodes[end] + np.multiply.outer(centers[outside] - centers[end], velocity)
    farthest = _FARTHEST * max(blocks.size)
    return np.clip(nodes, -farthest, farthest)


def _fit_blocks(
    track: Track, template: Template, sigma: float, weights: Array
) -> tuple[Array, Array]:
    """Return the affine errors of all blocks, (n, 2, rows, columns), and their information.

    The information about the coefficients is (n, 6, 6).
    """
    fits, number = [], len(track.nodes)
    basis, filtered = affine_basis(tile_counts(track.blocks.size)), template.filtered(sigma)
    for first in range(0, number, _BLOCKS_AT_ONCE):
        blocks = range(first, min(first + _BLOCKS_AT_ONCE, number))
        several = [
            equivalent_sums(track.nearby_sums(block), template.probability) for block in blocks
        ]
        sums = [(each.ones, each.trials, each.remainders, each.frames) for each in several]
        share = template.mean_trials, _MIN_SHARE_OF_OTHERS
        fits.append(engine.fit_blocks(filtered, share, sums, weights, basis, template.threads))
    errors, information = (np.concatenate(each) for each in zip(*fits, strict=True))
    return errors, information


def improve_inside(paths: Paths) -> Paths:
    """Return paths with better motions, from the pixels of each segment alone."""
    every = np.ones(tile_counts(paths.blocks.size))
    tracks = []
    for index, track in enumerate(paths.tracks):
        pixels = paths.labels == index
        part = track.inside(pixels)
        if pixels.any():
            for _ in range(_ROUNDS):
                improve_together(part, every)
        tracks.append(part.inside(None))
    return dataclasses.replace(paths, tracks=tracks)


def against_others(equations: Equations, sums: Sums, template: Template) -> Equations:
    """Return the equations of a block relative to the other blocks of the template.

    The block itself is a share of the template, which makes its apparent error smaller.
    """
    share = float(sums.trials.mean() / max(template.mean_trials, 1e-9))
    right = equations.right / max(1 - share, _MIN_SHARE_OF_OTHERS)
    return Equations(equations.information, right)


def sums_of_groups(track: Track) -> list[Sums]:
    """Return the sums of groups of successive blocks that are known."""
    groups = np.array_split(np.flatnonzero(track.known & track.blocks.is_lit), _GROUPS)
    return [
        Sums.total((track.nearby_sums(int(block)) for block in group), track.blocks.threads)
        for group in groups
        if len(group)
    ]


def agreement(groups: list[Sums], template: Template) -> Array:
    """Return weights of tiles, (rows, columns): 1 where groups of blocks agree with the template.

    Objects that hide parts of a segment for some time would draw its motion away. So the weight
    tends to 0 where χ² is large.
    """
    excess = np.mean([mean_tiles(chi_squared(each, template)) - 1 for each in groups], axis=0)
    usual = max(_MAX_EXCESS, float(np.median(excess)))
    return np.asarray(1 / (1 + (np.maximum(excess, 0) / usual) ** 2))


def template_and_agreement(track: Track, network: str = FAST) -> tuple[Template, Array]:
    """Return the template of the known blocks, denoised by a network, and its :func:`agreement`."""
    groups, threads = sums_of_groups(track), track.blocks.threads
    template = make_template(Sums.total(groups, threads), threads, network)
    return template, agreement(groups, template)


def template_of(
    track: Track, network: str = FAST, blocks: npt.NDArray[np.intp] | None = None
) -> Template:
    """Return the template of some blocks, all known ones by default, denoised by a network."""
    threads = track.blocks.threads
    blocks = np.flatnonzero(track.known) if blocks is None else blocks
    parts = (track.nearby_sums(int(block)) for block in blocks)
    return make_template(Sums.total(parts, threads), threads, network)


def weights_at(time: float, blocks: Blocks) -> Array:
    """Return the weights of the displacements of all blocks whose sum is that at a time."""
    number = len(blocks.centers)
    place = float(np.interp(time, blocks.centers, np.arange(number)))
    frames = round(float(np.diff(blocks.edges).mean()))
    return cubic_weights(number, place, interpolation_bias(frames))
