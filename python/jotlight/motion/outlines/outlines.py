"""Outlines: which of several motions each pixel follows."""

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Labels
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.disagreement import chi_squared
from jotlight.motion.displacements.scoring import make_template
from jotlight.motion.displacements.track import Track, from_center

_CENTRAL_FRACTION = 8
"""The central 1/8 of the blocks are the template."""

_GROUPS = 16
"""Number of groups of blocks that are compared with it."""

_MAX_COST = 5.0
"""Values of χ² above this one count as this one."""

_OTHER_SIDE = 0.25
"""Weight of the side of the reference time on which a motion explains the pixel worse.

Something may hide the pixel before or after the reference time, but rarely both.
"""

_LENGTH = 3.0
"""Cost of an outline per pixel of its length, in units of the mean χ² of a pixel."""

_CELL = 4
"""Width of the squares in which outlines are searched, in pixels."""

_MARGIN = 0.05
"""Cost of all motions but the most frequent one."""


def choose_labels(tracks: Sequence[Track]) -> Labels:
    """Return the index of the motion that each pixel follows, (H, W).

    The cost of a motion is the mean χ² of the blocks along it, compared with the central blocks.
    Outlines are short: the total cost includes their length.
    """
    size = tracks[0].blocks.size
    if len(tracks) == 1:
        return np.zeros(size, np.uint8)
    costs = np.stack([_cost(track) for track in tracks])
    excess = costs - costs.mean(axis=0)
    smooth = np.stack([_with_short_outlines(each) for each in excess])
    frequent = int(np.bincount(smooth.argmin(axis=0).ravel()).argmax())
    smooth[frequent] -= _MARGIN
    return np.asarray(smooth.argmin(axis=0), np.uint8)


def _cost(track: Track) -> npt.NDArray[np.float32]:
    """Return the mean χ² of each pixel along a motion, mostly of the better side in time."""
    number = len(track.nodes)
    order = from_center(track)
    central = max(2, number // _CENTRAL_FRACTION)
    threads = track.blocks.threads

    def total(blocks: Iterable[int]) -> Sums:
        return Sums.total((track.sums(int(block)) for block in blocks), threads)

    template = make_template(total(order[:central]), threads)
    length = max(1, number // _GROUPS)
    sides = []
    for is_later in (False, True):
        blocks = [
            int(block)
            for block in order[central:]
            if (track.blocks.centers[block] > track.reference) == is_later
        ]
        groups = [blocks[first : first + length] for first in range(0, len(blocks), length)]
        if not groups:
            continue
        costs = [np.minimum(chi_squared(total(group), template), _MAX_COST) for group in groups]
        sides.append(np.mean(costs, axis=0))
    low, high = np.min(sides, axis=0), np.max(sides, axis=0)
    return np.asarray((1 - _OTHER_SIDE) * low + _OTHER_SIDE * high, np.float32)


def _with_short_outlines(cost: npt.NDArray[np.float32]) -> Array:
    """Return a cost whose level sets minimize its sum plus the cost of their outlines, (H, W).

    The minimizer of total variation has this property (Rudin, Osher, and Fatemi 1992; Chambolle
    2004).
    """
    from scipy.ndimage import zoom
    from skimage.restoration import denoise_tv_chambolle

    height, width = cost.shape
    padded = np.pad(cost, ((0, -height % _CELL), (0, -width % _CELL)), mode="edge")
    rows, columns = (length // _CELL for length in padded.shape)
    cells = padded.reshape(rows, _CELL, columns, _CELL).mean(axis=(1, 3), dtype=np.float64)
    smooth = denoise_tv_chambolle(cells, weight=_LENGTH / _CELL, max_num_iter=300)
    fine = zoom(smooth, _CELL, order=1, mode="nearest", grid_mode=True)
    return np.asarray(fine[:height, :width])
