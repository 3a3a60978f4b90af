"""The motion of a window of frames, carried to the next window."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.formats.capture import CountStack
from jotlight.motion.align import prepare_burst
from jotlight.motion.counts.block_edges import window_edges
from jotlight.motion.counts.sensor_blocks import as_blocks
from jotlight.motion.displacements.affine import (
    SIGMAS,
    extrapolate,
    find_after_gap,
    improve_against,
    improve_block,
    improve_inside,
    template_and_agreement,
    template_of,
)
from jotlight.motion.displacements.regularize import fit_affine
from jotlight.motion.displacements.scoring import normal_equations
from jotlight.motion.displacements.tile_updates import improve_tiles, improve_tiles_together
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.merge import as_paths
from jotlight.motion.motion import Motion
from jotlight.motion.outlines.depth import refine_outlines
from jotlight.motion.outlines.outlines import choose_labels
from jotlight.motion.tiles import affine_inverse, tile_counts
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.sensor import Sensor

_MAX_STILL_GAIN = 18.0
"""Gain in nats by an affine motion of a block, above which a scene no longer stands still.

Twice the gain is χ² with six degrees of freedom, so this happens by chance once in 300,000 blocks.
"""


def carry(
    motion: Motion,
    data: Bits | CountStack,
    sensor: Sensor,
    step: int,
    threads: int | None = None,
) -> Paths | None:
    """Return the paths of a window, from the motion of the window that begins `step` frames before.

    The blocks that both windows share keep their displacements. New ones are aligned with them.
    Then all are improved together.

    Returns
    -------
    Paths or None
        None if a scene that stood still begins to move, if nothing stays in view, as after a cut to
        another scene, if the motion folds the image, or if all known blocks are dark.
    """
    burst, sensor = prepare_burst(data, sensor)
    blocks = as_blocks(burst, window_edges(len(burst), step), sensor, threads)
    before = dataclasses.replace(
        motion, times=motion.times - step, reference=motion.reference - step
    )
    try:
        seen = before.seen_from(float(len(burst) // 2))
    except ValueError:
        # A wrong motion of tiles may fold the image, so that its displacements have no bounds.
        return None
    paths = as_paths(seen, blocks)
    if not _stays_in_view(paths):
        return None
    # Edges are rounded, so centers differ by up to half a frame.
    known = blocks.centers <= before.times[-1] + 0.5
    if not (known & blocks.is_lit).any():
        return None
    if motion.model == "none":
        return None if _begins_to_move(paths.tracks[0], known) else paths
    _add_blocks(paths, known, has_tiles=motion.model == "tiles")
    return _with_outlines(paths) if _stays_in_view(paths) else None


def _stays_in_view(paths: Paths) -> bool:
    """Return whether all displacements are smaller than the image."""
    longest = max(float(abs(track.nodes).max()) for track in paths.tracks)
    return longest < max(paths.blocks.size)  # False for NaN, too


def _add_blocks(paths: Paths, known: npt.NDArray[np.bool_], *, has_tiles: bool) -> None:
    """Align the new blocks of all tracks with those that are known.

    If the motion `has_tiles`, the last track is that of the tiles.
    """
    last = len(paths.tracks) - 1
    for index, track in enumerate(paths.tracks):
        is_of_tiles, pixels = has_tiles and index == last, paths.labels == index
        # The bits of other segments would draw the motion of a segment away.
        part = track if is_of_tiles or pixels.all() else track.inside(pixels)
        _add_blocks_of_track(part, known, is_of_tiles=is_of_tiles)
        paths.tracks[index] = part.inside(None)


def _with_outlines(paths: Paths) -> Paths:
    """Return paths whose segments have the outlines that the window shows."""
    if paths.free:
        return refine_outlines(dataclasses.replace(paths, labels=choose_labels(paths.tracks)))
    # The bits of one window may not say to which segment a smooth region belongs.
    paths = refine_outlines(paths, are_known=True)
    if len(paths.tracks) > 1:
        paths = refine_outlines(improve_inside(paths), are_known=True)
    return paths


def _add_blocks_of_track(track: Track, known: npt.NDArray[np.bool_], *, is_of_tiles: bool) -> None:
    """Align the new blocks of a track with those that are known, and improve all together."""
    track.known = known.copy()
    everywhere = np.ones(track.nodes.shape[2:])
    velocity = np.zeros(track.nodes.shape[1:])
    template, weights = template_and_agreement(track)
    for block in np.flatnonzero(~known):
        extrapolate(track, int(block), velocity)
        find_after_gap(track, int(block), template, everywhere)
        for sigma in SIGMAS:
            if is_of_tiles:
                improve_tiles(track, int(block), template, sigma)
            else:
                improve_block(track, int(block), template, sigma, everywhere)
        track.known[block] = True
    if is_of_tiles:
        improve_tiles_together(track, template)
    else:
        improve_against(track, template, weights)


def _begins_to_move(track: Track, known: npt.NDArray[np.bool_]) -> bool:
    """Return whether the new blocks of a scene that stood still have moved."""
    track.known = known.copy()
    template = template_of(track)
    inverse = affine_inverse(tile_counts(track.blocks.size))
    track.known[:] = True
    for block in np.flatnonzero(~known):
        equations = normal_equations(track.sums(int(block)), template, SIGMAS[-1])
        errors, information = fit_affine(equations, np.ones(track.nodes.shape[2:]))
        parameters = (errors.reshape(2, -1) @ inverse.T).ravel()
        if parameters @ information @ parameters / 2 > _MAX_STILL_GAIN:
            return True
    return False
