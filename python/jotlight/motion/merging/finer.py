"""Merging onto a grid of half pixels.

A reading of a jot integrates the light over a whole pixel, which is a square of 2 x 2 pixels of the
fine grid. Its place in the image, rounded to half pixels, decides which square it is. So there are
four times as many sums as jots. Pixel (i, j) of these sums is the square of the pixels (i, j) to
(i + 1, j + 1) of the fine image.

To count them, each frame is placed on the fine grid: its jots are the pixels with even rows and
columns, and the others do not count. The engine then shifts it by whole pixels of the fine grid.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Packed
from jotlight.motion.agreement.consistency import Consistent
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.burst import Burst, Planes
from jotlight.motion.counts.jots import Jots
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.tiles import interpolate_at, tile_centers
from jotlight.squares import repeat_squares


def _fine_bytes() -> npt.NDArray[np.uint16]:
    """Return the two bytes in which a 0 follows each bit of a byte, for all bytes."""
    bits = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1)
    fine = np.zeros((256, 16), np.uint8)
    fine[:, ::2] = bits
    return np.packbits(fine, axis=1).view(np.uint16)[:, 0]


_FINE_BYTES = _fine_bytes()


def fine_frames(packed: Packed, width: int) -> Packed:
    """Return packed frames (T, H, ceil(W / 8)) on the fine grid: (T, 2 H, ceil(2 W / 8)).

    Examples
    --------
    >>> frame = np.packbits([[1, 0, 1]], axis=1)
    >>> np.unpackbits(fine_frames(frame[None], 3)[0], axis=1, count=6).tolist()
    [[1, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 0]]
    """
    frames, height, _ = packed.shape
    length = -(-2 * width // 8)
    fine = np.zeros((frames, 2 * height, length), np.uint8)
    fine[:, ::2] = _FINE_BYTES[packed].view(np.uint8)[..., :length]
    return fine


def fine_paths(paths: Paths) -> Paths:
    """Return the same paths on the fine grid, over the same bits."""
    blocks = _fine_blocks(paths.blocks)
    tracks = [_fine_track(track, blocks) for track in paths.tracks]
    return dataclasses.replace(paths, tracks=tracks, labels=repeat_squares(paths.labels, 2))


def _fine_blocks(blocks: Blocks) -> Blocks:
    """Return the same blocks, whose frames are on the fine grid."""
    burst, (height, width) = blocks.burst, blocks.size

    def read(start: int, stop: int, channel: int | None) -> Planes:
        return [
            (weight, fine_frames(packed, width))
            for weight, packed in burst.read(start, stop, channel)
        ]

    valid = blocks.valid
    if valid is None:
        valid = np.packbits(np.ones((height, width), bool), axis=1)
    jots = blocks.jots
    if jots is not None:
        maps = np.zeros((3, 2 * height, 2 * width), np.float32)
        maps[:, ::2, ::2] = jots.maps
        jots = Jots(jots.threshold, jots.reference, maps)
    fine = Burst(
        frames=len(burst),
        size=(2 * height, 2 * width),
        trials=burst.trials,
        channels=burst.channels,
        color=burst.color,
        frame_bytes=4 * burst.frame_bytes,
        read=read,
        dark=burst.dark,
    )
    valid = fine_frames(valid[None], width)[0]
    return dataclasses.replace(blocks, burst=fine, valid=valid, jots=jots, step=1)


def _fine_track(track: Track, blocks: Blocks) -> Track:
    """Return the same displacements in pixels of the fine grid, at the centers of its tiles."""
    places = (tile_centers(blocks.size) / 2).astype(np.float32)
    nodes = np.stack([2 * interpolate_at(each.astype(np.float32), places) for each in track.nodes])
    # The information is not used for counting.
    information = np.zeros((len(nodes), 3, *nodes.shape[2:]))
    return Track(blocks, track.reference, nodes.astype(np.float64), track.known, information)


def count_fine(paths: Paths, consistent: Consistent) -> Sums:
    """Return the sums along fine paths, without pixels of blocks that disagree.

    Parameters
    ----------
    paths : Paths
        What :func:`fine_paths` returns.
    consistent : Consistent
        The sums along the paths on the grid of the jots.
    """
    total = Sums.zeros(paths.blocks.size)
    for block in range(len(consistent.masks)):
        # Tracks keep the sums of all blocks, and these are large. New ones do not.
        tracks = [dataclasses.replace(track) for track in paths.tracks]
        sums = dataclasses.replace(paths, tracks=tracks).sums(block)
        total += sums.masked(repeat_squares(consistent.mask(block), 2))
    return total
